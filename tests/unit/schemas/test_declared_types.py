"""Every declared type rejects invalid values; types and fields are found by inspection."""

from math import inf, nan, nextafter

import pytest
from msgspec import Struct, ValidationError, inspect, msgpack

from tests.support.declared_types import (
    EVERY,
    IN_THE_FILE,
    ON_THE_WIRE,
    REQUESTS,
    bare,
    fields,
    limits,
    numbers,
    valid,
    with_value,
)

FLOATS = [(type_, path) for type_ in EVERY for path in numbers(type_)]
IDS = [f"{type_.__name__}.{'.'.join(path)}" for type_, path in FLOATS]
Path = tuple[str, ...]


def test_the_search_finds_the_contracts_types():
    names = {type_.__name__ for type_ in ON_THE_WIRE}
    assert {"Pose", "Waypoint", "Setpoint", "Pressure", "SafetyState", "Info", "Error"} <= names
    assert len(REQUESTS) >= 7
    assert {"SafetyParams", "VehicleParams", "Params"} <= {type_.__name__ for type_ in IN_THE_FILE}
    assert len(FLOATS) > 100


@pytest.mark.parametrize("type_", EVERY)
def test_a_valid_message_round_trips(type_: type[Struct]):
    message = msgpack.decode(msgpack.encode(valid(type_)), type=type_)
    assert msgpack.decode(msgpack.encode(message), type=type_) == message


@pytest.mark.parametrize(("type_", "path"), FLOATS, ids=IDS)
def test_a_float_rejects_nan_and_values_out_of_bounds(type_: type[Struct], path: Path):
    table, bounds = valid(type_), limits(type_, path)
    least = bounds.ge if bounds.ge is not None else bounds.gt
    most = bounds.le if bounds.le is not None else bounds.lt
    assert least is not None
    assert most is not None
    beyond = [
        nextafter(least, -inf) if bounds.gt is None else float(least),
        nextafter(most, inf) if bounds.lt is None else float(most),
    ]
    for number in (nan, inf, -inf, *beyond, "1", True, None):
        with pytest.raises(ValidationError):
            msgpack.decode(with_value(table, path, number), type=type_)


@pytest.mark.parametrize(("type_", "path"), FLOATS, ids=IDS)
def test_a_float_accepts_its_bounds(type_: type[Struct], path: Path):
    bounds = limits(type_, path)
    for number in (bounds.ge, bounds.le):
        if number is not None:
            msgpack.decode(with_value(valid(type_), path, number), type=type_)


@pytest.mark.parametrize("type_", [*REQUESTS, *IN_THE_FILE])
def test_requests_and_parameters_reject_unknown_fields(type_: type[Struct]):
    with pytest.raises(ValidationError, match="unknown field `wrong`"):
        msgpack.decode(msgpack.encode(valid(type_) | {"wrong": 1}), type=type_)


@pytest.mark.parametrize("type_", EVERY)
def test_a_field_without_a_default_cannot_be_missing(type_: type[Struct]):
    for field in fields(type_):
        table = valid(type_)
        del table[field.encode_name]
        if field.required:
            with pytest.raises(ValidationError, match="missing required field"):
                msgpack.decode(msgpack.encode(table), type=type_)
        else:
            msgpack.decode(msgpack.encode(table), type=type_)


@pytest.mark.parametrize("type_", ON_THE_WIRE)
def test_integers_and_texts_of_messages_are_bounded(type_: type[Struct]):
    """Maps of `Info` and of parameters, and the texts of an error reply, have no limit."""
    for field in fields(type_):
        inner = bare(field.type)
        if isinstance(inner, inspect.IntType):
            assert inner.ge is not None
            assert inner.le is not None
        if isinstance(inner, inspect.StrType) and type_.__name__ != "Error":
            assert inner.max_length is not None


@pytest.mark.parametrize("type_", EVERY)
def test_every_type_has_a_docstring(type_: type[Struct]):
    assert (type_.__doc__ or "").partition("\n")[0].endswith((".", ":"))
