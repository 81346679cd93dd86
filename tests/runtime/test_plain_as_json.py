"""What is shown of any payload, JSON can carry."""

import io
import json
import sys
from datetime import UTC
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadctl.cli import output
from quadctl.services.runtime.bus.codec import to_jsonable

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
def test_it_is_shown_as_text_where_json_has_no_word_for_it(payload: bytes, shown: Any):
    found = to_jsonable(payload, "application/msgpack")
    assert found == shown or shown is None
    assert json.loads(msgspec.json.encode(found)) == found


def test_huge_whole_numbers_are_shown_whole():
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
SAID = st.sampled_from(["", "zenoh/bytes", "application/msgpack", "application/json", "text/json"])


@settings(max_examples=150)
@given(st.binary(max_size=40) | VALUES.map(pack), SAID)
def test_any_payload_can_be_printed_as_text_and_as_json(payload: bytes, said: str):
    value = to_jsonable(payload, said)
    kept, sys.stdout = sys.stdout, io.StringIO()
    try:
        output.document(value)
        strict(sys.stdout.getvalue())
        output.fields(value)
    finally:
        sys.stdout = kept
