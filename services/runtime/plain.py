"""Payloads of any origin, as they can be shown to a person."""

from collections.abc import Callable
from typing import Any

import msgspec


def plain(payload: bytes, said: str) -> Any:
    """MessagePack and JSON as data, text as text, anything else as hex.

    The encoding `said` tells which; where it tells nothing, what can be read is taken.
    """
    for attempt in _READERS.get(said.partition(";")[0], _ANY):
        try:
            return attempt(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            continue
    return payload.hex()


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
}
_ANY: tuple[Reader, ...] = (_json, _text, _msgpack)
