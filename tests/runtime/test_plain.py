"""Payloads of any origin, shown as well as they can be."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadctl.services.runtime.bus.codec import to_jsonable

PACKED = msgspec.msgpack.encode({"a": [1, 2.5]})


@pytest.mark.parametrize(
    ("payload", "said", "shown"),
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
def test_it_is_shown_as_what_it_is(payload: bytes, said: str, shown: object):
    assert to_jsonable(payload, said) == shown


SAID = st.sampled_from(["", "zenoh/bytes", "application/msgpack", "application/json", "text/plain"])


@given(st.binary(max_size=64), SAID)
def test_anything_can_be_shown(payload: bytes, said: str):
    to_jsonable(payload, said)


@pytest.mark.parametrize("payload", [b"\x91" * 100_000, b"[" * 100_000])
@pytest.mark.parametrize("said", ["", "application/msgpack", "application/json"])
def test_so_can_what_is_nested_beyond_reason(payload: bytes, said: str):
    assert isinstance(to_jsonable(payload, said), str)
