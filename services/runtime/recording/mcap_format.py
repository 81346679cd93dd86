"""Conversion of a bus message to its form in a recording, and back. Pure.

Viewers read JSON, so a message that survives JSON bit for bit is stored as JSON: our topics by
their types, other MessagePack maps if they come back the same. Anything else keeps its bytes.
"""

from typing import NamedTuple

import msgspec
from msgspec import Struct, inspect

from quadctl.schemas.topics import MESSAGES, topic_of
from quadctl.schemas.typeinfo import fields
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.nesting import is_too_deep

JSON, MSGPACK = "json", "msgpack"
_JSON_ENCODINGS = ("application/json", "text/json")
_BAD = (msgspec.MsgspecError, TypeError, ValueError, OverflowError, RecursionError)


class Stored(NamedTuple):
    """A message as stored in a recording.

    `encoding` is MCAP's name for the format of `data`. `packed` messages were MessagePack on the
    bus. `message` is the message decoded as one of our types, if possible; of another version,
    `data` has more fields than it, or fewer.
    """

    encoding: str
    packed: bool
    data: bytes
    message: Struct | None = None

    @property
    def type(self) -> type[Struct] | None:
        """Return our type whose schema `data` follows, if any."""
        return None if self.message is None else type(self.message)


class Form:
    """Storage format of the messages of one key and one Zenoh encoding."""

    def __init__(self, key: str, encoding: str) -> None:
        topic = topic_of(key)
        self._encoding = encoding
        # A user's node may publish our types on other keys.
        named: type[Struct] | None = topic.type if topic else None
        self._type = MESSAGES.get(codec.type_name(encoding), named)
        self._exact = self._type is not None and encoding == codec.encoding(self._type)
        # Of another version; decoding would drop its fields that we lack, and fill in ours.
        self._other = codec.is_typed(encoding) and "#" in encoding and not self._exact
        # A free table may hold values that JSON lacks, e.g. infinity.
        self._free = self._type is not None and any(
            isinstance(field.type, inspect.DictType) for field in fields(self._type)
        )

    def stored(self, payload: bytes) -> Stored:
        """Return the message in the most readable format that loses nothing."""
        if (message := self._typed(payload)) is not None:
            data = msgspec.json.encode(message)
            if not (self._free or self._other) or restored(data, packed=True) == payload:
                return Stored(JSON, True, data, message)
        if (table := _as_json(payload)) is not None:
            return Stored(JSON, True, table, message if self._other else None)
        if self._is_json_table(payload):
            return Stored(JSON, False, payload)
        packed = self._encoding.startswith("application/msgpack")
        return Stored(MSGPACK if packed else self._encoding, False, payload)

    def _typed(self, payload: bytes) -> Struct | None:
        if self._type is None:
            return None
        try:
            message: Struct = codec.decode(self._type, payload, self._encoding)
        except Invalid:
            return None
        if self._exact or self._other:
            return message
        # Decoding would lose fields that another program added to ours.
        names = {field.encode_name for field in fields(self._type)}
        return None if msgspec.msgpack.decode(payload).keys() - names else message

    def _is_json_table(self, payload: bytes) -> bool:
        if not (self._encoding.startswith(_JSON_ENCODINGS) or payload[:1] == b"{"):
            return False
        try:
            value = msgspec.json.decode(payload)
        except _BAD:
            return False
        return isinstance(value, dict) and not is_too_deep(value, payload)


def restored(data: bytes, *, packed: bool) -> bytes:
    """Return the payload that a message had on the bus."""
    return msgspec.msgpack.encode(msgspec.json.decode(data)) if packed else data


def _as_json(payload: bytes) -> bytes | None:
    """Return a MessagePack map as JSON; None if JSON would lose something."""
    try:
        value = msgspec.msgpack.decode(payload)
        if not isinstance(value, dict) or is_too_deep(value):
            return None
        data = msgspec.json.encode(value)
        return data if restored(data, packed=True) == payload else None
    except _BAD:
        return None
