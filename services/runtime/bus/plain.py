"""Payloads of any origin, as they can be shown to a person and written as JSON."""

import math
from collections.abc import Callable
from typing import Any

import msgspec

_DEEPEST = 100
"""Levels of nesting that are shown; JSON readers take that many, and people do not."""


def plain(payload: bytes, said: str) -> Any:
    """MessagePack and JSON as data, text as text, anything else as hex.

    The encoding `said` tells which; where it tells nothing, what can be read is taken. What JSON
    cannot carry becomes text: bytes are hex, NaN and the infinities `nan`, `inf` and `-inf`, a
    time is ISO 8601, an extension `{"ext": its code, "data": hex}`, and a map's keys are text.
    """
    for attempt in _READERS.get(said.partition(";")[0], _ANY):
        try:
            return _carried(attempt(payload))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            continue
    return payload.hex()


def _carried(value: Any, depth: int = 0) -> Any:
    """The value as JSON carries it."""
    if depth > _DEEPEST:
        raise RecursionError
    match value:
        case dict():
            return _table(value, depth)
        case list() | tuple():
            return [_carried(item, depth + 1) for item in value]
        case bytes():
            return value.hex()
        case float() if not math.isfinite(value):
            return str(value)
        case msgspec.msgpack.Ext():
            return {"ext": value.code, "data": bytes(value.data).hex()}
    return msgspec.to_builtins(value)  # a time becomes text


def _table(value: dict[Any, Any], depth: int) -> Any:
    carried = {_key(name): _carried(item, depth + 1) for name, item in value.items()}
    if len(carried) == len(value):
        return carried
    # 1 and "1" are one name in JSON: as pairs, nothing is lost.
    return [[_carried(name, depth + 1), _carried(item, depth + 1)] for name, item in value.items()]


def _key(name: Any) -> str:
    return name if isinstance(name, str) else msgspec.json.encode(_carried(name)).decode()


def _msgpack(payload: bytes) -> Any:
    return msgspec.msgpack.decode(payload)


def _json(payload: bytes) -> Any:
    return msgspec.json.decode(payload)


def _text(payload: bytes) -> str:
    text = payload.decode()
    if any(ord(char) < ord(" ") and char not in "\t\r\n" for char in text):
        raise UnicodeDecodeError("utf-8", payload, 0, 1, "control character")
    return text


Reader = Callable[[bytes], Any]
_READERS: dict[str, tuple[Reader, ...]] = {
    "application/msgpack": (_msgpack,),
    "application/json": (_json,),
    "text/json": (_json,),
}
_ANY: tuple[Reader, ...] = (_json, _text, _msgpack)
