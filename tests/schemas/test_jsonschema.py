"""The schemas that recordings carry are such as viewers read: whole, and every field with a type."""

import msgspec
import pytest

from quadctl.schemas.topics import GOTO, TOPICS, called
from quadctl.schemas.typeinfo import json_schema
from quadctl.services.recorder.foxglove import FrameTransform, SceneUpdate

TYPES = [*(topic.type for topic in TOPICS), called(GOTO).type, FrameTransform, SceneUpdate]
PLAIN = {"boolean", "string", "number", "integer"}


@pytest.mark.parametrize("type_", TYPES, ids=lambda type_: type_.__name__)
def test_a_viewer_finds_the_type_of_every_field(type_):
    schema = json_schema(type_)
    assert schema["title"] == type_.__name__
    assert list(schema["properties"]) == list(type_.__struct_fields__)
    assert "$ref" not in msgspec.json.encode(schema).decode()
    reads(schema)


def reads(schema: dict) -> None:
    """As Lichtblick's parser goes through a schema; what it does not know it refuses to open."""
    assert schema["type"] == "object"
    for name, field in schema["properties"].items():
        kind = field["type"]
        if kind == "object":
            reads(field)
        elif kind == "array":
            if field["items"]["type"] != "object":
                assert field["items"]["type"] in PLAIN, name
            else:
                reads(field["items"])
        else:
            assert kind in PLAIN, name


def test_bounds_and_meanings_stand_in_it():
    schema = json_schema(TOPICS[0].type)
    x = schema["properties"]["position"]["properties"]["x"]
    assert (x["minimum"], x["maximum"]) == (-10_000, 10_000)
    assert "ENU" in schema["description"]
