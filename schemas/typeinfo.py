"""Message types as text, as a digest and as JSON Schema."""

import zlib
from collections.abc import Iterator
from functools import cache
from typing import Any

import msgspec
from msgspec import Struct, inspect

from quadctl.schemas.typed import BUILDING


def json_schema(type_: type[Struct]) -> dict[str, Any]:
    """Return the schema of a type's JSON, with all nested types written out in place.

    Viewers do not follow references, need a `type` beside an `enum`, and need `properties` for
    every object, even for a free table.
    """
    with BUILDING:
        (schema,), types = msgspec.json.schema_components(  # noqa: TID251
            [type_], ref_template="{name}"
        )
    whole: dict[str, Any] = _written_out(schema, types)
    return whole


def _written_out(part: dict[str, Any], types: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in part:
        return _written_out(types[part["$ref"]], types)
    whole = dict(part)
    if "enum" in whole:
        whole.setdefault("type", "string")
    if whole.get("type") == "object":
        properties = whole.get("properties", {})
        whole["properties"] = {
            name: _written_out(field, types) for name, field in properties.items()
        }
    for inner in ("items", "additionalProperties"):
        if isinstance(whole.get(inner), dict):
            whole[inner] = _written_out(whole[inner], types)
    for several in ("anyOf", "prefixItems"):
        if several in whole:
            whole[several] = [_written_out(each, types) for each in whole[several]]
    return whole


def described(type_: Any) -> inspect.Type:
    """Return the description of a type by msgspec."""
    with BUILDING:
        return inspect.type_info(type_)  # noqa: TID251


@cache
def schema_hash(type_: type[Struct]) -> str:
    """Return eight hex digits that change with a field, its type or its bounds."""
    text = "\n".join(_lines(described(type_), bounds=True))
    return f"{zlib.crc32(text.encode()):08x}"


def definition(type_: type[Struct]) -> str:
    """Return the fields in the format of `rosmsg show`, nested ones indented."""
    return "\n".join(_lines(described(type_), bounds=False))


def service_definition(request: type[Struct], response: type[Struct]) -> str:
    """Return request and response in the format of `rossrv show`."""
    return "\n".join(part for part in (definition(request), "---", definition(response)) if part)


def fields(type_: type[Struct]) -> tuple[inspect.Field, ...]:
    """Return the fields of a type, with their types."""
    found = described(type_)
    assert isinstance(found, inspect.StructType)  # noqa: S101 - a Struct is one
    return found.fields


def parts(type_: type[Struct]) -> Iterator[type[Struct]]:
    """Yield the Struct types of a type's fields and lists, recursively."""
    for field in fields(type_):
        inner = field.type
        if isinstance(inner, inspect.ListType | inspect.VarTupleType):
            inner = inner.item_type
        if isinstance(inner, inspect.StructType):
            yield inner.cls
            yield from parts(inner.cls)


def type_name(type_: inspect.Type) -> str:
    """Return a type's name in ROS style, e.g. `float64`, `string[]` or `Position`."""
    match type_:
        case inspect.BoolType():
            return "bool"
        case inspect.IntType():
            return "uint64" if type_.ge == 0 else "int64"
        case inspect.FloatType():
            return "float64"
        case inspect.StrType() | inspect.LiteralType():
            return "string"
        case inspect.ListType():
            return f"{type_name(type_.item_type)}[]"
        case inspect.DictType():
            return f"map<{type_name(type_.key_type)},{type_name(type_.value_type)}>"
        case inspect.StructType():
            return str(type_.cls.__name__)
        case inspect.Metadata():
            return type_name(type_.type)
        case inspect.UnionType():
            return "|".join(type_name(member) for member in type_.types)
        case _:
            return "any"


def bounds_text(type_: inspect.Type) -> str:
    """Return the bounds of a type, e.g. `[-5, 5]`, `(0, 200]` or `a|b`; empty without bounds."""
    match type_:
        case inspect.IntType() | inspect.FloatType():
            low, high = _first(type_.gt, type_.ge), _first(type_.lt, type_.le)
            if low is None and high is None:
                return ""
            left = "[" if type_.ge is not None else "("
            right = "]" if type_.le is not None else ")"
            return f"{left}{low}, {high}{right}"
        case inspect.LiteralType():
            return "|".join(str(value) for value in type_.values)
        case inspect.Metadata():
            return bounds_text(type_.type)
        case _:
            return ""


def _first(*values: float | None) -> float | None:
    return next((value for value in values if value is not None), None)


def _lines(type_: inspect.Type, *, bounds: bool, indent: str = "") -> Iterator[str]:
    if not isinstance(type_, inspect.StructType):
        return
    for field in type_.fields:
        limits = f" {bounds_text(field.type)}" if bounds else ""
        yield f"{indent}{type_name(field.type)} {field.encode_name}{limits}".rstrip()
        yield from _lines(field.type, bounds=bounds, indent=f"{indent}  ")
