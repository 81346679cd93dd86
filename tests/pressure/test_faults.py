"""What goes wrong with a sensor, laid over its readings."""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadctl.schemas.barometer import FaultParams
from quadctl.services.pressure.barometer import SensorFaults

READINGS = st.lists(st.floats(900, 1100), min_size=1, max_size=50)


def faults(seed: int = 0, **params: object) -> tuple[SensorFaults, FaultParams]:
    made = FaultParams(**params)  # type: ignore[arg-type]  # its fields, by name
    return SensorFaults(made, random.Random(seed)), made


def given_by(layer: SensorFaults, raw: list[float], begin: float = 0.0) -> list[float | None]:
    """What comes of readings at 10 Hz."""
    return [layer.through(begin + n / 10, value) for n, value in enumerate(raw)]


@given(READINGS)
def test_without_one_readings_are_handed_on_as_they_are(raw: list[float]):
    assert given_by(faults()[0], raw) == raw


@given(READINGS, READINGS, READINGS)
def test_stuck_it_repeats_the_last_value_until_it_is_well(
    before: list[float], stuck: list[float], after: list[float]
):
    layer, params = faults()
    given_by(layer, before)
    params.kind = "stuck"
    assert given_by(layer, stuck, 10.0) == [before[-1]] * len(stuck)
    params.kind = "none"
    assert given_by(layer, after, 20.0) == after


def test_stuck_from_the_start_it_holds_its_first_value():
    assert given_by(faults(kind="stuck")[0], [1.0, 2.0, 3.0]) == [1.0, 1.0, 1.0]


def test_off_it_gives_nothing_and_then_goes_on():
    layer, params = faults(kind="off")
    assert given_by(layer, [1.0, 2.0]) == [None, None]
    params.kind = "none"
    assert given_by(layer, [3.0], 0.2) == [3.0]


def test_stuck_after_off_it_holds_what_it_gave_last():
    layer, params = faults()
    given_by(layer, [1.0])
    params.kind = "off"
    given_by(layer, [2.0], 0.1)
    params.kind = "stuck"
    assert given_by(layer, [3.0], 0.2) == [1.0]


def test_glitches_are_of_the_size_up_and_down_and_come_at_the_mean_interval():
    layer, _ = faults(kind="glitch", magnitude=3.0, interval=2.0)
    found = given_by(layer, [1000.0] * 50_000)
    assert set(found) == {997.0, 1000.0, 1003.0}
    at = [n for n, value in enumerate(found) if value != 1000.0]
    gaps = np.diff(at) / 10
    assert gaps.mean() == pytest.approx(2.0, rel=0.1)
    assert gaps.std() == pytest.approx(2.0, rel=0.15)  # at random, not in step
    assert found.count(997.0) / len(at) == pytest.approx(0.5, abs=0.05)


@given(st.integers(0, 1000))
def test_the_same_seed_gives_the_same_glitches(seed: int):
    raw = [1000.0] * 100
    one, other, another = (
        given_by(faults(number, kind="glitch")[0], raw) for number in (seed, seed, seed + 1)
    )
    assert one == other
    assert one != another


@given(st.integers(0, 100), READINGS)
def test_delayed_it_gives_the_value_of_then_and_nothing_before_the_first(
    late: int, raw: list[float]
):
    layer, _ = faults(kind="delay", delay=late / 10)
    assert given_by(layer, raw) == [None] * min(late, len(raw)) + raw[: max(len(raw) - late, 0)]


def test_a_delay_put_in_later_gives_old_values_at_once_and_a_new_one_counts():
    layer, params = faults()
    given_by(layer, [float(n) for n in range(300)])
    params.kind, params.delay = "delay", 10.0
    assert layer.through(30.0, 300.0) == 200.0
    params.delay = 0.35
    # Between two readings the one before it is what was known.
    assert layer.through(30.1, 301.0) == 297.0


def test_a_boot_has_no_old_values_of_the_one_before():
    layer, _ = faults(kind="delay", delay=0.1)
    assert given_by(layer, [1.0, 2.0], 50.0) == [None, 1.0]
    assert given_by(layer, [3.0, 4.0], 0.0) == [None, 3.0]


def test_of_the_past_no_more_is_kept_than_can_be_asked_for():
    layer, _ = faults()
    given_by(layer, [0.0] * 10_000)
    assert len(layer._past) <= 102
