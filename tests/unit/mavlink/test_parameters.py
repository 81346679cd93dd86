"""Parameters in the form of MAVLink's."""

import struct
from math import inf, isnan, nan

import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.params import Params
from quadctl.services.bridges.mavlink import parameters
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.catalogue import leaves
from quadctl.services.runtime.params.names import flatten

INTEGER, REAL = 6, 9


def test_every_number_of_the_schema_has_a_short_name_of_its_own():
    from msgspec import to_builtins

    values = dict(flatten(to_builtins(Params())))
    found = parameters.table({name: each for name, each in values.items() if name in leaves()})
    names = [each.name for each in found]
    assert len(set(names)) == len(names) > 40
    assert all(len(name) <= 16 and name.isascii() for name in names)
    assert names == sorted(names)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_a_real_number_comes_back_in_its_shortest_form(value: float):
    (each,) = parameters.table({"safety.margin": value})
    back = parameters.decoded(each.type, each.value, 0.0)
    assert struct.pack("<f", back) == struct.pack("<f", value)


@pytest.mark.parametrize("value", [0.15, 0.1, 1e-4, 5.0, 10_000.0])
def test_a_decimal_comes_back_as_it_was_written(value: float):
    sent = struct.unpack("<f", struct.pack("<f", value))[0]
    assert parameters.decoded(REAL, sent, 1.0) == value


@given(st.integers(-(2**31), 2**31 - 1))
def test_an_integer_comes_back_or_is_left_out(value: int):
    found = parameters.table({"dynamics.seed": value})
    is_no_number = value & 0x7F800000 == 0x7F800000 and value & 0x7FFFFF
    assert bool(found) != bool(is_no_number)
    if found:
        assert parameters.decoded(INTEGER, found[0].value, 0) == value


def test_a_bool_is_an_integer():
    (each,) = parameters.table({"safety.cage_on": True})
    assert each.type == INTEGER
    assert parameters.decoded(INTEGER, each.value, present=False) is True


@pytest.mark.parametrize(
    ("type_", "value", "present"),
    [
        (INTEGER, 1.0, 2.0), (REAL, 1.0, 2), (REAL, nan, 1.0), (REAL, inf, 1.0), (INTEGER, nan, 1),
        (INTEGER, 3e-45, True), (2, 0.0, 1),
    ],
)  # fmt: skip
def test_a_value_of_another_type_is_refused(type_: int, value: float, present: float):
    with pytest.raises(Invalid):
        parameters.decoded(type_, value, present)


def test_texts_and_tables_are_left_out():
    assert not parameters.table({"pressure.source": "simulated", "safety.zones": []})
    assert not isnan(parameters.table({"dynamics.seed": 1})[0].value)


def test_a_users_own_parameter_does_not_take_the_name_of_ours():
    (each,) = parameters.table({"safety.takeoff_x": 1.0, "sensor.takeoff_x": 2.0})
    assert each.own == "safety.takeoff_x"
