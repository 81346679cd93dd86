"""Messages and single fields as `topic echo` shows them."""

from typing import Any

import msgspec
import pytest

from quadctl.cli.topic.echo import NoField, field_of, shown, split
from quadctl.schemas.messages import Waypoint
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.errors import Invalid

POINT = Waypoint(1.0, 2.0, 3.0)
PACKED = codec.encode(POINT)


def show(message: RawMessage) -> Any:
    return shown(message, message.key, "uav")


def message(key: str, payload: bytes, encoding: str = "") -> RawMessage:
    return RawMessage(key, payload, encoding, 0, 0)


@pytest.mark.parametrize("key", ["uav/input/position_request", "x/input/position_request", "a/b"])
@pytest.mark.parametrize("encoding", ["", codec.encoding(Waypoint), "application/msgpack"])
def test_a_waypoint_is_decoded_on_any_key(key: str, encoding: str):
    assert show(message(key, PACKED, encoding)) == msgspec.to_builtins(POINT)


@pytest.mark.parametrize(
    "payload", [b"\xc1", b"{}", b"hello", b"", msgspec.msgpack.encode({"x": 1})]
)
def test_on_a_known_topic_another_payload_is_invalid(payload: bytes):
    with pytest.raises(Invalid):
        show(message("uav/input/position_request", payload))


def test_a_topic_name_under_a_foreign_prefix_implies_no_type():
    assert show(message("camera/pose", b'{"tilt": 3}', "application/json")) == {"tilt": 3}
    other = codec.encoding(Waypoint).replace("#", "#0")
    with pytest.raises(Invalid, match="schema mismatch"):
        show(message("camera/input/position_request", PACKED, other))


DATA = {"a": {"b": [10, {"c": 5}]}, "0": "zero", "d/e": {"f": 6}}


@pytest.mark.parametrize(
    ("path", "found"),
    [
        ("a.b.0", 10),
        ("a.b.1.c", 5),
        ("0", "zero"),
        ("a.b", [10, {"c": 5}]),
        ("", DATA),
        ("a/b/1/c", 5),
        ("/a/b.0", 10),
        ("d/e.f", 6),
    ],
)
def test_a_field_is_found_by_its_path(path: str, found: Any):
    assert field_of(DATA, path) == found


@pytest.mark.parametrize(
    ("path", "has"),
    [
        ("q", "in the message there is: a, 0, d/e"),
        ("a.q", "in a there is: b"),
        ("a/q", "in a there is: b"),
        ("a.b.2", "in a.b there is: a list of 2"),
        ("a.b.-1", "a list of 2"),
        ("0.x", "in 0 there is: no fields"),
        ("a.b.x", "list"),
    ],
)
def test_a_missing_field_is_an_error_with_the_existing_ones(path: str, has: str):
    with pytest.raises(NoField, match=f"no field {path}") as caught:
        field_of(DATA, path)
    assert has in caught.value.hint


def test_message_published_on_a_pattern_is_decoded_as_subscribed():
    sent = message("uav/**", PACKED)
    assert shown(sent, "uav/input/position_request", "uav") == msgspec.to_builtins(POINT)
    with pytest.raises(Invalid):
        shown(sent, "uav/pose", "uav")
    assert shown(sent, "uav/*", "uav") == msgspec.to_builtins(POINT)


@pytest.mark.parametrize(
    ("name", "topic", "field"),
    [
        ("/uav/pose/position", "uav/pose", "position"),
        ("pose/position/x", "pose", "position.x"),
        ("/uav/input/position/position/z", "uav/input/position", "position.z"),
        ("uav/safety/state/goal", "uav/safety/state", "goal"),
        ("info/topics/pose", "info", "topics.pose"),
    ],
)
def test_a_field_after_a_topic_is_split_off(name: str, topic: str, field: str):
    assert split(name) == (topic, field)


@pytest.mark.parametrize(
    "name",
    ["pose", "uav/pose", "uav/pose/image", "uav/input/position_request", "a/b/pose/stamp", ""],
)
def test_other_names_are_not_split(name: str):
    assert split(name) == (name, "")
