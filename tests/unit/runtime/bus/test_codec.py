"""Encoding and decoding of messages, and any other bytes on the wire."""

import io
import json
import subprocess
import sys
from datetime import UTC
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings, strategies as st
from msgspec import Struct

from quadctl.cli import output
from quadctl.schemas.digests import go_together
from quadctl.schemas.messages import Info, Pose, SafetyState, Waypoint
from quadctl.schemas.services import (
    CalibrateRequest,
    CalibrateResponse,
    Call,
    Error,
    GotoRequest,
    SetParamsRequest,
)
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.codec import to_jsonable
from quadctl.services.runtime.errors import (
    WIRE_ERRORS,
    AlreadyServed,
    Expired,
    Invalid,
    NotReady,
    QuadctlError,
    Refused,
    SchemaMismatch,
    TimedOut,
)
from tests.support.declared_types import ON_THE_WIRE, numbers, valid, with_value

PACKED = msgspec.msgpack.encode({"a": [1, 2.5]})


@pytest.mark.parametrize(
    ("payload", "encoding", "shown"),
    [
        (PACKED, "application/msgpack;quadctl.Pose#00000000", {"a": [1, 2.5]}),
        (PACKED, "application/msgpack", {"a": [1, 2.5]}),
        (PACKED, "", {"a": [1, 2.5]}),
        (PACKED, "zenoh/bytes", {"a": [1, 2.5]}),
        (b'{"a": 1}', "application/json", {"a": 1}),
        (b'{"a": 1}', "zenoh/bytes", {"a": 1}),
        (b"hello\n", "text/plain", "hello\n"),
        ("grüße".encode(), "zenoh/string", "grüße"),
        (b"3.5", "text/plain", 3.5),
        (b"\x01", "zenoh/bytes", 1),
        (b"\xc1\xff", "zenoh/bytes", "c1ff"),
        (b"\xc1", "application/msgpack", "c1"),
        (b"nonsense", "application/json", "6e6f6e73656e7365"),
        (b"", "zenoh/bytes", ""),
    ],
)
def test_a_payload_is_shown_by_its_encoding(payload: bytes, encoding: str, shown: object):
    assert to_jsonable(payload, encoding) == shown


ENCODINGS_SHOWN = st.sampled_from(
    ["", "zenoh/bytes", "application/msgpack", "application/json", "text/plain"]
)


@given(st.binary(max_size=64), ENCODINGS_SHOWN)
def test_any_payload_can_be_shown(payload: bytes, encoding: str):
    to_jsonable(payload, encoding)


@pytest.mark.parametrize("payload", [b"\x91" * 100_000, b"[" * 100_000])
@pytest.mark.parametrize("encoding", ["", "application/msgpack", "application/json"])
def test_extreme_nesting_is_shown_as_text(payload: bytes, encoding: str):
    assert isinstance(to_jsonable(payload, encoding), str)


Ext = msgspec.msgpack.Ext
pack = msgspec.msgpack.encode


@pytest.mark.parametrize(
    ("payload", "shown"),
    [
        (pack({"a": b"\x00\xff"}), {"a": "00ff"}),
        (pack([Ext(5, b"abc")]), [{"ext": 5, "data": "616263"}]),
        (b"\xd6\xff\x00\x00\x00\x01", "1970-01-01T00:00:01Z"),
        (pack({1: 2, None: 4}), {"1": 2, "null": 4}),
        (pack({b"\x01": 2, (1, 2): 3, 1.5: 4}), {'"01"': 2, "[1,2]": 3, "1.5": 4}),
        (b"\x82\x01\xa1a\xa11\xa1b", [[1, "a"], ["1", "b"]]),
        (pack([float("nan"), float("inf"), float("-inf")]), ["nan", "inf", "-inf"]),
        (pack(2**64 - 1), 2**64 - 1),
        (b"\x91" * 99 + b"\x01", None),
        (b"\x91" * 500 + b"\x01", "91" * 500 + "01"),
    ],
)
def test_values_that_json_lacks_are_shown_as_text(payload: bytes, shown: Any):
    found = to_jsonable(payload, "application/msgpack")
    assert found == shown or shown is None
    assert json.loads(msgspec.json.encode(found)) == found


def test_huge_integers_are_shown_in_full():
    assert to_jsonable(b"[1%s]" % (b"0" * 40), "application/json") == [10**40]


def strict(text: str) -> Any:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


LEAVES = (
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.binary(max_size=4)
    | st.text(max_size=4) | st.builds(Ext, st.integers(-128, 127).filter(lambda c: c != -1), st.binary(max_size=4))
    | st.datetimes(timezones=st.just(UTC))
)  # fmt: skip
KEYS = st.integers(-5, 5) | st.text(max_size=2) | st.floats() | st.binary(max_size=2) | st.none()
VALUES = st.recursive(
    LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3), max_leaves=10
)  # fmt: skip
ANY_ENCODING = st.sampled_from(
    ["", "zenoh/bytes", "application/msgpack", "application/json", "text/json"]
)


@settings(max_examples=150)
@given(st.binary(max_size=40) | VALUES.map(pack), ANY_ENCODING)
def test_any_payload_can_be_printed_as_text_and_as_json(payload: bytes, encoding: str):
    value = to_jsonable(payload, encoding)
    kept, sys.stdout = sys.stdout, io.StringIO()
    try:
        output.document(value)
        strict(sys.stdout.getvalue())
        output.fields(value)
    finally:
        sys.stdout = kept


METRES = st.floats(-10_000, 10_000)
MSGPACK = "application/msgpack;quadctl."
DEEP = b"\x91" * 100_000
"""Nested arrays, deeper than any reader's stack."""
ENCODINGS = st.one_of(
    st.text("application/msgpack;quadctl.#0", max_size=40),
    st.sampled_from([type_.__name__ for type_ in ON_THE_WIRE]).map(MSGPACK.__add__),
)


@given(st.sampled_from(ON_THE_WIRE), st.floats(0, 1))
def test_a_message_round_trips(type_: type[Struct], number: float):
    table = valid(type_)
    for path in numbers(type_):
        table = msgspec.msgpack.decode(with_value(table, path, number))
    message = msgspec.convert(table, type_)
    assert codec.decode(type_, codec.encode(message), codec.encoding(type_)) == message


@given(METRES, METRES, METRES, st.booleans())
def test_numbers_round_trip_to_the_last_bit(x: float, y: float, z: float, replace: bool):
    back = codec.decode(GotoRequest, codec.encode(GotoRequest(x, y, z, replace)), "")
    assert [a.hex() for a in (back.x, back.y, back.z)] == [a.hex() for a in (x, y, z)]
    assert back.replace is replace


def test_the_encoding_names_the_type_and_its_hash():
    assert codec.encoding(CalibrateRequest) == f"{MSGPACK}CalibrateRequest#d4c4fd3c"


def test_the_payload_is_a_map_by_field_names():
    assert msgspec.msgpack.decode(codec.encode(Waypoint(1.0, 2.0, 3.0))) == {
        "x": 1.0,
        "y": 2.0,
        "z": 3.0,
    }


def test_another_hash_is_refused_and_both_are_named():
    payload = codec.encode(CalibrateRequest(True))
    with pytest.raises(SchemaMismatch) as caught:
        codec.decode(CalibrateRequest, payload, f"{MSGPACK}CalibrateRequest#0badcafe")
    assert "CalibrateRequest#0badcafe" in caught.value.message
    assert "CalibrateRequest#d4c4fd3c" in caught.value.message
    assert caught.value.hint


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [("1.0", "1.0"), ("1.1.1.0", "1.0"), ("1.0", "1.1.1.0"), ("1.2.1.1.1.0", "1.1.1.0")],
)
def test_a_version_goes_together_with_those_that_it_follows(ours: str, theirs: str):
    digests = {"1.0": "d4c4fd3c", "1.1.1.0": "11111111.d4c4fd3c"}
    digests["1.2.1.1.1.0"] = f"22222222.{digests['1.1.1.0']}"
    assert go_together(digests[ours], digests[theirs])


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("11111111", "d4c4fd3c"),
        # Two that both follow a third may have given one name to different fields.
        ("11111111.d4c4fd3c", "22222222.d4c4fd3c"),
        ("11111111.d4c4fd3c", "33333333.22222222"),
        ("d4c4fd3c", "d4c4fd3"),
        ("d4c4fd3c", "."),
    ],
)
def test_versions_of_which_none_follows_the_other_do_not_fit(one: str, other: str):
    assert not go_together(one, other)
    assert not go_together(other, one)


def test_a_newer_sender_of_an_unknown_field_is_told_what_to_do():
    newer = f"{MSGPACK}CalibrateRequest#11111111.d4c4fd3c"
    payload = codec.encode(CalibrateRequest(True))
    assert codec.decode(CalibrateRequest, payload, newer) == CalibrateRequest(True)
    more = msgspec.msgpack.encode({"zero": True, "slowly": True})
    for encoding, text in ((newer, "newer"), (f"{MSGPACK}CalibrateRequest#d4c4fd3c", "type show")):
        with pytest.raises(Invalid, match="unknown field `slowly`") as caught:
            codec.decode(CalibrateRequest, more, encoding)
        assert text in caught.value.hint


def test_another_type_is_refused_even_with_the_same_fields():
    payload = codec.encode(Waypoint(1.0, 2.0, 3.0))
    for encoding in (codec.encoding(Waypoint), f"{MSGPACK}Waypoint"):
        with pytest.raises(SchemaMismatch, match="Waypoint"):
            codec.decode(GotoRequest, payload, encoding)


@pytest.mark.parametrize(
    "encoding",
    ["", "application/msgpack", f"{MSGPACK}Waypoint", f"{MSGPACK}Waypoint#", "zenoh/bytes"],
)
def test_without_a_hash_the_fields_decide(encoding: str):
    assert codec.decode(Waypoint, b"\x83\xa1x\x01\xa1y\x02\xa1z\x03", encoding) == Waypoint(1, 2, 3)
    with pytest.raises(Invalid) as caught:
        codec.decode(Waypoint, b"\x82\xa1x\x01\xa1y\x02", encoding)
    assert "missing required field `z`" in caught.value.message
    assert caught.value.hint == "`quadctl type show Waypoint` prints its fields"


def test_the_hint_for_a_users_own_type_names_no_command_that_does_not_know_it():
    class Light(msgspec.Struct):
        on: bool

    with pytest.raises(Invalid) as caught:
        codec.decode(Light, b"\x80", "")
    assert caught.value.hint == "see Light in its node"


@settings(max_examples=500)
@given(st.sampled_from(ON_THE_WIRE), st.binary(max_size=64), ENCODINGS)
def test_garbage_raises_only_invalid(type_: type[Struct], payload: bytes, encoding: str):
    try:
        message = codec.decode(type_, payload, encoding)
    except Invalid:
        return
    assert isinstance(message, type_)


WORDS = st.text("xyz.0\0\n", max_size=4)
JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers(-(2**63), 2**64 - 1) | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.parametrize("type_", [Pose, Info, SetParamsRequest, SafetyState, Call])
@settings(max_examples=25)
@given(data=st.data())
def test_well_formed_nonsense_raises_only_invalid(type_: type[Struct], data: st.DataObject):
    names = st.sampled_from(type_.__struct_fields__)
    table = valid(type_) | data.draw(st.dictionaries(names, JSON, max_size=3))
    try:
        message = codec.decode(type_, msgspec.msgpack.encode(table), "")
    except Invalid:
        return
    assert isinstance(message, type_)


@pytest.mark.parametrize(
    ("type_", "payload"),
    [
        (Pose, b"\x81\xa7unknown" + DEEP),
        (Pose, DEEP),
        (SetParamsRequest, b"\x81\xa6values\x81\xa1a" + DEEP),
        (SetParamsRequest, b"\x81\xa6values\x81\xa1a\x81\x81\xa1b\xc0\xc0"),
        (SetParamsRequest, b"\x81\xa6values\xdf\xff\xff\xff\xff"),
        (SetParamsRequest, b"\x81\xa6values\x81\xa1a\xdd\xff\xff\xff\xff"),
        (SetParamsRequest, b"\x81\xa6values\x81\xa1a\xd7\xff" + b"\xff" * 8),
        (SetParamsRequest, b"\x81\xa6values\x81\xa1\xff\x00"),
        (SetParamsRequest, b"\x81\xa6values\x81\xa1q\xc7\x03\x05ext"),
    ],
    ids=[
        "deep unknown",
        "deep",
        "deep value",
        "map as key",
        "long map",
        "long",
        "time",
        "text",
        "ext",
    ],
)
def test_hostile_payloads_raise_only_invalid(type_: type[Struct], payload: bytes):
    with pytest.raises(Invalid, match="not a valid"):
        codec.decode(type_, payload, "")


def test_a_number_beyond_its_bounds_is_named():
    with pytest.raises(Invalid, match=r"`\$\.baseline`: it is 6079\.5"):
        codec.decode(CalibrateResponse, codec.encode({"baseline": 6079.5}), "")


@pytest.mark.parametrize("error", WIRE_ERRORS.values())
def test_an_error_round_trips(error: type[QuadctlError]):
    back = codec.decode_error(codec.encode_error(error("what and why", "what to do")))
    assert type(back) is error
    assert (back.message, back.hint) == ("what and why", "what to do")


@pytest.mark.parametrize(
    ("error", "code"),
    [(SchemaMismatch, "invalid"), (TimedOut, "internal"), (AlreadyServed, "internal"),
     (NotReady, "not_ready"), (Refused, "refused"), (Expired, "expired"), (Invalid, "invalid"),
     (QuadctlError, "internal")],
)  # fmt: skip
def test_an_error_has_one_of_five_codes_on_the_wire(error: type[QuadctlError], code: str):
    sent = msgspec.json.decode(codec.encode_error(error("m", "h")))
    assert sent == {"code": code, "message": "m", "hint": "h"}
    assert msgspec.convert(sent, Error).code == code
    assert codec.ERROR_ENCODING == "application/json;quadctl.Error"


@given(st.one_of(st.binary(max_size=64), st.just(b"[" * 100_000)))
def test_unreadable_error_reply_is_still_an_error(payload: bytes):
    assert isinstance(codec.decode_error(payload), QuadctlError)


def test_a_call_is_decoded_rejected_or_absent():
    ticket = Call("a", 5.0)
    assert codec.decode_call(None) is None
    assert codec.decode_call(codec.encode(ticket)) == ticket
    bad: list[Any] = [
        {}, {"id": "a"}, {"id": "", "deadline": 5}, {"id": "a" * 65, "deadline": 5},
        {"id": "a", "deadline": float("nan")}, {"id": "a", "deadline": -1}, {"id": 1, "deadline": 5},
    ]  # fmt: skip
    for attachment in bad:
        with pytest.raises(Invalid):
            codec.decode_call(msgspec.msgpack.encode(attachment))


FRESH_TYPES = """
import sys, threading
from typing import Literal
import msgspec
from quadctl.services.runtime.bus import codec

sys.setswitchinterval(1e-6)
for number in range(20):
    inner = msgspec.defstruct("Inner", [("word", Literal[f"a{number}", "b", "c"]), ("value", float)])
    outer = msgspec.defstruct("Outer", [("inner", inner), ("all", dict[str, inner])])
    payload = codec.encode({"inner": {"word": "b", "value": 1.0}, "all": {}})
    together = threading.Barrier(4)

    def decode():
        together.wait()
        assert codec.decode(outer, payload, "").inner.value == 1.0

    threads = [threading.Thread(target=decode) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
"""


def test_threads_may_decode_a_new_type_at_the_same_time():
    # In its own process: a half-built type would crash it.
    done = subprocess.run(
        [sys.executable, "-c", FRESH_TYPES], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
