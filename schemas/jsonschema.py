"""Types as JSON Schema, in the form that viewers of recordings read."""

from typing import Any

import msgspec
from msgspec import Struct


def json_schema(type_: type[Struct]) -> dict[str, Any]:
    """The schema of a type's JSON, with every type in it written out in its place.

    Viewers follow no references, ask for a `type` beside an `enum`, and for `properties` of every
    object, of a free table as well.
    """
    (schema,), types = msgspec.json.schema_components([type_], ref_template="{name}")
    whole: dict[str, Any] = _written_out(schema, types)
    return whole


def _written_out(part: dict[str, Any], types: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in part:
        return _written_out(types[part["$ref"]], types)
    whole = dict(part)
    if "enum" in whole:
        whole.setdefault("type", "string")
    if whole.get("type") == "object":
        fields = whole.get("properties", {})
        whole["properties"] = {name: _written_out(field, types) for name, field in fields.items()}
    for inner in ("items", "additionalProperties"):
        if isinstance(whole.get(inner), dict):
            whole[inner] = _written_out(whole[inner], types)
    return whole
