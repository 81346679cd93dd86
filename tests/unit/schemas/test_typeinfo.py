"""Types as text and as JSON schema, and the hash that distinguishes their versions."""

import subprocess
import sys
import zlib
from typing import Annotated, Any, Literal

import msgspec
import pytest
from hypothesis import given, strategies as st
from msgspec import Meta, Struct

from quadctl.schemas.messages import Pose, SafetyState, Waypoint
from quadctl.schemas.services import (
    CalibrateRequest,
    CalibrateResponse,
    GetParamsRequest,
    GetParamsResponse,
    HoldRequest,
    HoldResponse,
)
from quadctl.schemas.topics import GOTO, MESSAGES, TOPICS, called
from quadctl.schemas.typeinfo import (
    bounds_text,
    definition,
    json_schema,
    schema_hash,
    service_definition,
    type_name,
)
from quadctl.services.runtime.recording.scene import FrameTransform, SceneUpdate
from tests.support.declared_types import ON_THE_WIRE

TYPES = [*MESSAGES.values(), called(GOTO).type, FrameTransform, SceneUpdate]
PLAIN_TYPES = {"boolean", "string", "number", "integer"}


@pytest.mark.parametrize("type_", TYPES, ids=lambda type_: type_.__name__)
def test_the_json_schema_gives_the_type_of_every_field(type_):
    schema = json_schema(type_)
    assert schema["title"] == type_.__name__
    assert list(schema["properties"]) == list(type_.__struct_fields__)
    assert "$ref" not in msgspec.json.encode(schema).decode()
    check_readable(schema)


def check_readable(schema: dict) -> None:
    """Check a schema as Lichtblick's parser does: it refuses unknown kinds of fields."""
    assert schema["type"] == "object"
    for name, field in schema["properties"].items():
        kind = field["type"]
        if kind == "object":
            check_readable(field)
        elif kind == "array":
            if field["items"]["type"] != "object":
                assert field["items"]["type"] in PLAIN_TYPES, name
            else:
                check_readable(field["items"])
        else:
            assert kind in PLAIN_TYPES, name


def test_the_json_schema_has_bounds_and_descriptions():
    schema = json_schema(TOPICS[0].type)
    x = schema["properties"]["position"]["properties"]["x"]
    assert (x["minimum"], x["maximum"]) == (-10_000, 10_000)
    assert "ENU" in schema["description"]


BOUNDS = st.floats(-1e6, 1e6)
Fields = list[tuple[str, Any]]


def made(fields: Fields, name: str = "Made") -> type[Struct]:
    return msgspec.defstruct(name, fields)


def digest(fields: Fields, name: str = "Made") -> str:
    return schema_hash(made(fields, name))


def bounded(least: float, most: float) -> Any:
    return Annotated[float, Meta(ge=least, le=most)]


def test_the_definition_of_calibrate_is_as_in_the_lab():
    text = service_definition(CalibrateRequest, CalibrateResponse)
    assert text == "bool zero\n---\nfloat64 baseline"


def test_an_empty_request_is_shown_as_in_ros():
    assert service_definition(HoldRequest, HoldResponse) == "---\nbool success"


def test_nested_fields_are_indented():
    lines = definition(Pose).splitlines()
    assert lines[:7] == [
        "string boot",
        "uint64 seq",
        "float64 stamp",
        "Position position",
        "  float64 x",
        "  float64 y",
        "  float64 z",
    ]
    assert "string state" in definition(SafetyState)
    assert definition(Waypoint) == "float64 x\nfloat64 y\nfloat64 z"


def test_lists_and_maps_are_shown_with_their_contents():
    assert definition(GetParamsRequest) == "string[] names"
    assert definition(GetParamsResponse) == "map<string,any> values\nmap<string,any> in_force"


@pytest.mark.parametrize(
    ("type_", "name", "bounds"),
    [
        (bool, "bool", ""),
        (int, "int64", ""),
        (Annotated[int, Meta(ge=0)], "uint64", "[0, None)"),
        (Annotated[int, Meta(ge=-1, lt=2)], "int64", "[-1, 2)"),
        (float, "float64", ""),
        (Annotated[float, Meta(gt=0, le=200)], "float64", "(0, 200]"),
        (Annotated[float, Meta(ge=-5, le=5, description="d")], "float64", "[-5, 5]"),
        (str, "string", ""),
        (Literal["b", "a"], "string", "a|b"),
        (list[Waypoint], "Waypoint[]", ""),
        (dict[str, int], "map<string,int64>", ""),
        (str | list[str], "string|string[]", ""),
        (Any, "any", ""),
    ],
)
def test_every_type_has_a_name_and_its_bounds(type_: Any, name: str, bounds: str):
    described = msgspec.inspect.type_info(type_)
    assert type_name(described) == name
    assert bounds_text(described) == bounds


def test_the_hash_is_the_crc_of_the_definition():
    assert schema_hash(CalibrateRequest) == f"{zlib.crc32(b'bool zero'):08x}" == "d4c4fd3c"
    assert schema_hash(HoldRequest) == "00000000"


@pytest.mark.parametrize("type_", ON_THE_WIRE)
def test_a_hash_is_eight_hex_digits(type_: type[Struct]):
    assert len(schema_hash(type_)) == 8
    assert int(schema_hash(type_), 16) >= 0


def test_types_with_different_fields_have_different_hashes():
    seen = {(definition(type_), schema_hash(type_)) for type_ in ON_THE_WIRE}
    assert len(seen) == len({hash_ for _, hash_ in seen}) > 15


def test_the_hash_is_the_same_in_another_process():
    code = (
        "from quadctl.schemas.messages import *\n"
        "from quadctl.schemas.typeinfo import schema_hash\n"
        "print(schema_hash(Pose), schema_hash(SafetyState))"
    )
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(filter(None, sys.path))},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.split() == [schema_hash(Pose), schema_hash(SafetyState)]


@given(st.tuples(BOUNDS, BOUNDS), st.tuples(BOUNDS, BOUNDS))
def test_a_changed_bound_changes_the_hash(one: tuple[float, float], other: tuple[float, float]):
    same = one == other
    assert (digest([("x", bounded(*one))]) == digest([("x", bounded(*other))])) is same


PLAIN: Fields = [("x", bounded(-5, 5)), ("n", int), ("inner", made([("y", float)], "Inner"))]


OTHERS: dict[str, Fields] = {
    "a field less": PLAIN[:2],
    "a field more": [*PLAIN, ("more", bool)],
    "another order": [PLAIN[1], PLAIN[0], PLAIN[2]],
    "another name": [("w", PLAIN[0][1]), *PLAIN[1:]],
    "an open lower bound": [("x", Annotated[float, Meta(gt=-5, le=5)]), *PLAIN[1:]],
    "an open upper bound": [("x", Annotated[float, Meta(ge=-5, lt=5)]), *PLAIN[1:]],
    "no bounds": [("x", float), *PLAIN[1:]],
    "another number": [("x", Annotated[int, Meta(ge=-5, le=5)]), *PLAIN[1:]],
    "a bound": [PLAIN[0], ("n", Annotated[int, Meta(ge=0)]), PLAIN[2]],
    "another name inside": [*PLAIN[:2], ("inner", made([("z", float)], "Inner"))],
    "a bound inside": [*PLAIN[:2], ("inner", made([("y", bounded(0, 1))], "Inner"))],
    "another type inside": [*PLAIN[:2], ("inner", made([("y", float)], "Other"))],
    "no table inside": [*PLAIN[:2], ("inner", str)],
}


@pytest.mark.parametrize("what", OTHERS)
def test_a_changed_field_changes_the_hash(what: str):
    assert digest(OTHERS[what]) != digest(PLAIN)


def test_a_changed_choice_changes_the_hash():
    assert digest([("s", Literal["a", "b"])]) != digest([("s", Literal["a", "c"])])
    assert digest([("s", Literal["a", "b"])]) == digest([("s", Literal["b", "a"])])


def test_the_type_name_does_not_change_the_hash():
    assert digest(PLAIN, "Another") == digest(PLAIN)
