"""Plain data and JSON as typed values, from any thread.

A second thread can see a type that msgspec has half built, and the process crashes: eight threads
that convert the parameters first, and at once, did so in 31 of 60 processes.
"""

from _thread import RLock  # threading takes 2 ms of `status`
from typing import Any, TypeVar

import msgspec

T = TypeVar("T")

BUILDING = RLock()
"""Lock for whatever may be the first to use a type."""


def converted(value: Any, type_: type[T]) -> T:
    """Return plain data as a type; raise msgspec.ValidationError."""
    with BUILDING:
        return msgspec.convert(value, type_)


def from_json(data: bytes, type_: type[T]) -> T:
    """Return JSON as a type; raise msgspec.DecodeError."""
    with BUILDING:
        return msgspec.json.decode(data, type=type_)
