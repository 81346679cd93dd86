"""Plain data and JSON as values of our types, from any thread.

A second thread can see a type that msgspec has half built, and the process crashes: eight threads that
convert the parameters first, and at once, did so in 31 of 60 processes. So whatever may be the first to
use a type holds BUILDING: conversions here, decoders, and descriptions of types.
"""

from _thread import RLock  # threading takes 2 ms of `status`
from typing import Any, TypeVar

import msgspec

T = TypeVar("T")

BUILDING = RLock()
"""Lock for whatever may be the first to use a type."""


def converted(value: Any, type_: type[T], *, strict: bool = True) -> T:
    """Return plain data as a type; raise msgspec.ValidationError."""
    with BUILDING:
        return msgspec.convert(value, type_, strict=strict)  # noqa: TID251


def from_json(data: bytes | str, type_: type[T]) -> T:
    """Return JSON as a type; raise msgspec.DecodeError."""
    with BUILDING:
        return msgspec.json.decode(data, type=type_)


def json_decoder(type_: Any) -> "msgspec.json.Decoder[Any]":  # noqa: TID251
    """Return a decoder of JSON of a type."""
    with BUILDING:
        return msgspec.json.Decoder(type_)  # noqa: TID251
