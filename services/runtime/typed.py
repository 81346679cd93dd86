"""Plain data and JSON as typed values, from any thread, and checks of a program's arguments.

A second thread can see a type that msgspec has half built, and the process crashes: eight threads
that convert the parameters first, and at once, did so in 31 of 60 processes.
"""

from _thread import RLock  # threading takes 2 ms of `status`
from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec

from quadctl.services.runtime.errors import Invalid

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


def require(given: Any, kind: type, example: str) -> None:
    """Raise Invalid if a program names a topic or service by a text, as in other systems."""
    if not isinstance(given, kind):
        raise Invalid(
            f"{given!r} is no {kind.__name__}",
            f"give one, e.g. {example} of quadctl.schemas.topics",
        )


def argument(name: str, value: Any, kind: type | tuple[type, ...], what: str) -> None:
    """Raise Invalid unless an argument has this kind, in words `what`; True is no number."""
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise _wrong(name, value, what)


def positive_time(name: str, value: Any) -> None:
    """Raise Invalid unless an argument is a time, s: a number above 0, also infinity."""
    from numbers import Real

    argument(name, value, Real, _TIME)
    if not value > 0:
        raise _wrong(name, value, _TIME)


def plain(value: Any) -> Any:
    """Return a value with NumPy's numbers and arrays as Python's own."""
    if isinstance(value, Mapping):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value.tolist() if hasattr(value, "tolist") else value


_TIME = "a time, s, above 0"


def _wrong(name: str, value: Any, what: str) -> Invalid:
    import reprlib

    return Invalid(f"{name} = {reprlib.repr(value)} is not {what}", f"give {what}")
