"""Form of recorded messages: JSON if JSON can represent them, and exact to the bit."""

from typing import Any

import msgspec
import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.messages import Called, Pose, SafetyState
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.recording.mcap_format import JSON, MSGPACK, Form, restored
from tests.support.bags import pose, refused, state

pack = msgspec.msgpack.encode
numbers = st.integers(-(2**63), 2**64 - 1) | st.floats() | st.booleans() | st.none()
values = st.recursive(
    numbers | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text() | st.integers(-9, 9), inner),
    max_leaves=10,
)
PLAIN = "application/msgpack"


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("uav/pose", pose(7, x=1 / 3)),
        ("uav7/pose", pose(7)),
        ("uav/safety/state", state(1e-9, reason="outside the cage: x = 9 ist außerhalb")),
        ("uav/@call/goto", refused(9, 0, 1)),
        ("ghost/where", pose(3)),
    ],
)
def test_known_types_are_stored_as_json_and_round_trip(key, message):
    payload = codec.encode(message)
    stored = Form(key, codec.encoding(type(message))).stored(payload)
    assert (stored.encoding, stored.type, stored.packed) == (JSON, type(message), True)
    assert msgspec.json.decode(stored.data, type=type(message)) == message
    assert restored(stored.data, packed=True) == payload


@given(st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3))
def test_every_digit_of_a_number_is_kept(xyz):
    payload = pack(dict(zip("xyz", xyz, strict=True)))
    stored = Form("uav/input/position_request", PLAIN).stored(payload)
    assert restored(stored.data, packed=True) == payload


@given(values, st.sampled_from([PLAIN, "zenoh/bytes", "", "application/msgpack;quadctl.Gps#0"]))
def test_unknown_messages_round_trip_to_the_bit(value, encoding):
    payload = pack(value)
    stored = Form("my/own", encoding).stored(payload)
    assert stored.type is None
    assert restored(stored.data, packed=stored.packed) == payload
    assert not (stored.encoding == JSON and isinstance(msgspec.json.decode(stored.data), list))


@given(st.binary(), st.sampled_from(["zenoh/bytes", "application/json", PLAIN, "text/plain"]))
def test_any_bytes_round_trip(payload, encoding):
    for key in ("my/own", "uav/pose"):
        stored = Form(key, encoding).stored(payload)
        assert restored(stored.data, packed=stored.packed) == payload


def test_json_is_stored_unchanged():
    stored = Form("my/own", "application/json").stored(b'{"a": 1.0}')
    assert stored == (JSON, False, b'{"a": 1.0}', None)


def test_a_pose_of_another_version_is_kept_without_our_type():
    encoding = "application/msgpack;quadctl.Pose#deadbeef"
    stored = Form("uav/pose", encoding).stored(codec.encode(pose(1)))
    assert (stored.encoding, stored.type, stored.packed) == (JSON, None, True)


@pytest.mark.parametrize("changed", [{"gust": 0.5}, {"leg": None}])
def test_a_state_of_a_version_that_fits_has_our_type_and_its_own_fields(changed: dict[str, Any]):
    fields = {
        name: part for name, part in msgspec.to_builtins(state(1)).items() if name not in changed
    }
    payload = pack(fields | {name: part for name, part in changed.items() if part})
    encoding = f"application/msgpack;quadctl.SafetyState#11111111.{codec.digest(SafetyState)}"
    stored = Form("uav/safety/state", encoding).stored(payload)
    assert (stored.encoding, stored.type, stored.message) == (JSON, SafetyState, state(1))
    assert restored(stored.data, packed=True) == payload


def test_unknown_fields_of_a_known_type_are_kept():
    more = msgspec.to_builtins(pose(1)) | {"battery": 0.5}
    stored = Form("uav/pose", PLAIN).stored(pack(more))
    assert stored.type is None
    assert msgspec.json.decode(stored.data)["battery"] == 0.5
    assert Form("uav/pose", PLAIN).stored(codec.encode(pose(1))).type is Pose


def test_a_pose_that_json_cannot_represent_stays_messagepack():
    bad = msgspec.to_builtins(pose(1)) | {"stamp": float("nan")}
    stored = Form("uav/pose", PLAIN).stored(pack(bad))
    assert (stored.encoding, stored.data) == (MSGPACK, pack(bad))


def test_a_call_that_json_cannot_represent_is_kept_as_bytes():
    bad = msgspec.structs.replace(refused(1, 2, 3), request={"x": float("inf")})
    stored = Form("uav/@call/goto", codec.encoding(Called)).stored(codec.encode(bad))
    assert restored(stored.data, packed=stored.packed) == codec.encode(bad)
