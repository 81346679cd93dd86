"""The air, against published values of the U.S. Standard Atmosphere 1976."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadctl.services.pressure.simulated import pressure_at

# Metres to pascals, computed apart with the standard's own constants: their exponent has more
# digits than the formula's 5.255876, which is 0.0003 Pa at 1000 m, 0.03 mm of height.
TABLE = [(1, 101312.9874), (10, 101204.9263), (100, 100129.4386), (1000, 89874.5705)]


@pytest.mark.parametrize(("height", "pascals"), TABLE)
def test_the_pressure_at_a_height(height: float, pascals: float):
    assert pressure_at(height) * 100 == pytest.approx(pascals, abs=4e-4)


def test_sea_level_is_the_standards_own_constant():
    assert pressure_at(0) == 1013.25


def test_it_falls_by_twelve_pascals_a_metre_near_the_ground():
    assert (pressure_at(0.5) - pressure_at(-0.5)) * 100 == pytest.approx(-12.013, abs=1e-3)


@given(st.floats(-100, 11_000), st.floats(0.001, 1000))
def test_higher_is_always_less(height: float, more: float):
    assert pressure_at(height + more) < pressure_at(height)
