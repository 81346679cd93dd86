"""Checks of a program's arguments."""

from collections.abc import Mapping
from typing import Any

from quadctl.services.runtime.errors import Invalid


def require(given: Any, kind: type, example: str) -> None:
    """Raise Invalid unless a program gives an object of a kind, and e.g. no topic's name for a topic."""
    if not isinstance(given, kind):
        import reprlib

        raise Invalid(f"{reprlib.repr(given)} is no {kind.__name__}", f"give one, e.g. {example}")


def require_function(given: Any) -> None:
    """Raise Invalid unless a program gives a function, e.g. as a handler."""
    if not callable(given):
        import reprlib

        raise Invalid(f"{reprlib.repr(given)} is no function", "give a function of one argument")


def positive_rate(value: Any) -> None:
    """Raise Invalid unless an argument is a rate, Hz: a finite number above 0."""
    from numbers import Real

    argument("hz", value, Real, _RATE)
    if not 0 < value < float("inf"):
        raise _wrong("hz", value, _RATE)


def argument(name: str, value: Any, kind: type | tuple[type, ...], what: str) -> None:
    """Raise Invalid unless an argument has this kind, in words `what`; True is no number.

    A text must be one that a file's name or a message can have.
    """
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise _wrong(name, value, what)
    if isinstance(value, str) and ("\0" in value or not _is_unicode(value)):
        raise _wrong(name, value, what)


def positive_time(name: str, value: Any) -> float:
    """Return an argument that is a time, s, as a plain float, at most 10^6; raise Invalid for others."""
    if type(value) is not float:
        from numbers import Real

        argument(name, value, Real, _TIME)
    if not value > 0:
        raise _wrong(name, value, _TIME)
    try:
        return min(float(value), _LONGEST)
    except OverflowError:  # an int with more than 308 digits
        return _LONGEST


def plain(value: Any) -> Any:
    """Return a value with numbers and arrays of NumPy, and fractions, as Python's own.

    Raises Invalid for a list or table that has no end in itself.
    """
    try:
        return _as_plain(value)
    except RecursionError as error:
        raise Invalid("a value is nested too deep, or in itself", "give a plain one") from error


def _as_plain(value: Any) -> Any:
    if type(value) in _PLAIN:
        return value
    if isinstance(value, Mapping):
        return {name: _as_plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_as_plain(part) for part in value]
    if hasattr(value, "tolist"):
        return value.tolist()
    from numbers import Real

    return float(value) if isinstance(value, Real) else value


_PLAIN = {bool, int, float, str, type(None)}
_TIME = "a time, s, above 0"
_RATE = "a rate, Hz, above 0"
_LONGEST = 1e6
"""Seconds, some days: Zenoh's and Python's clocks take no time without an end."""


def _is_unicode(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _wrong(name: str, value: Any, what: str) -> Invalid:
    import reprlib

    return Invalid(f"{name} = {reprlib.repr(value)} is not {what}", f"give {what}")
