"""Every type that the contract declares, found by inspection, and a valid value of each."""

from collections.abc import Iterator
from types import ModuleType
from typing import Any

from msgspec import Struct, inspect, msgpack, to_builtins

from quadctl.schemas import barometer, messages, params, services, vehicle
from quadctl.schemas.zones import ZoneParams


def _declared(module: ModuleType) -> tuple[type[Struct], ...]:
    return tuple(
        thing
        for thing in vars(module).values()
        if isinstance(thing, type)
        and issubclass(thing, Struct)
        and thing.__module__ == module.__name__
    )


ON_THE_WIRE = (
    *_declared(messages),
    *_declared(services),
)
REQUESTS = tuple(type_ for type_ in ON_THE_WIRE if type_.__name__.endswith("Request"))
IN_THE_FILE = (*_declared(params), *_declared(barometer), *_declared(vehicle))
EVERY = (*ON_THE_WIRE, *IN_THE_FILE)


def bare(type_: inspect.Type) -> inspect.Type:
    return bare(type_.type) if isinstance(type_, inspect.Metadata) else type_


def fields(type_: type[Struct]) -> tuple[inspect.Field, ...]:
    described = inspect.type_info(type_)
    assert isinstance(described, inspect.StructType)
    return described.fields


def value(type_: inspect.Type) -> Any:
    """Return a value that the type accepts."""
    match type_:
        case inspect.BoolType():
            return True
        case inspect.IntType() | inspect.FloatType():
            return type_.le or type_.ge or 0
        case inspect.StrType():
            return "a"
        case inspect.LiteralType():
            return type_.values[0]
        case inspect.ListType():
            return [value(type_.item_type)]
        case inspect.VarTupleType():
            return (value(type_.item_type),)
        case inspect.StructType() if type_.cls is ZoneParams:
            return {"name": "a", "polygon": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]}
        case inspect.DictType():
            return {value(type_.key_type): value(type_.value_type)}
        case inspect.StructType():
            return valid(type_.cls)
        case inspect.Metadata():
            return value(type_.type)
        case inspect.UnionType():
            return value(type_.types[0])
        case inspect.AnyType():
            return 1
    raise AssertionError(f"no sample for {type_}")


def valid(type_: type[Struct]) -> dict[str, Any]:
    """Return a map that decodes as the type, with its defaults or else sample values."""
    try:
        return dict(to_builtins(type_()))
    except TypeError:
        return {field.encode_name: value(field.type) for field in fields(type_)}


def numbers(type_: type[Struct], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the path of every float in a type and its nested types."""
    for field in fields(type_):
        inner, here = bare(field.type), (*path, field.encode_name)
        if isinstance(inner, inspect.FloatType):
            yield here
        elif isinstance(inner, inspect.StructType):
            yield from numbers(inner.cls, here)


def limits(type_: type[Struct], path: tuple[str, ...]) -> inspect.FloatType:
    """Return the float at a path, with its bounds."""
    first, *rest = path
    inner = bare(next(field.type for field in fields(type_) if field.encode_name == first))
    if rest:
        assert isinstance(inner, inspect.StructType)
        return limits(inner.cls, tuple(rest))
    assert isinstance(inner, inspect.FloatType)
    return inner


def with_value(table: dict[str, Any], path: tuple[str, ...], number: Any) -> bytes:
    """Return the map as MessagePack, with another value at a path."""
    changed = msgpack.decode(msgpack.encode(table))
    inner = changed
    for part in path[:-1]:
        inner = inner[part]
    inner[path[-1]] = number
    return msgpack.encode(changed)
