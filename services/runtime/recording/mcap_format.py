"""Form of a bus message in a recording, and the way back. Pure.

Viewers read JSON, so a message that JSON carries to the bit is stored as JSON: our topics by their
types, other maps of MessagePack if they come back the same. Anything else stays the bytes that it
was.
"""

from typing import NamedTuple

import msgspec
from msgspec import Struct, inspect

from quadctl.schemas.topics import TOPICS, topic_of
from quadctl.schemas.typeinfo import fields
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid

JSON, MSGPACK = "json", "msgpack"
_JSON_ENCODINGS = ("application/json", "text/json")
_TYPES: dict[str, type[Struct]] = {topic.type.__name__: topic.type for topic in TOPICS}
_BAD = (msgspec.MsgspecError, TypeError, ValueError, OverflowError, RecursionError)


class Stored(NamedTuple):
    """A message as it stands in a recording.

    `encoding` is MCAP's name of what `data` is.
    `packed` says that it is MessagePack on the bus. `message` is it as one of our types.
    """

    encoding: str
    packed: bool
    data: bytes
    message: Struct | None = None

    @property
    def type(self) -> type[Struct] | None:
        """The type whose schema `data` follows, where it is one of ours."""
        return None if self.message is None else type(self.message)


class Form:
    """How the messages of one key and one Zenoh encoding are stored."""

    def __init__(self, key: str, said: str) -> None:
        topic = topic_of(key)
        self._said = said
        # A node of somebody's own may publish our types on keys of its own.
        named: type[Struct] | None = topic.type if topic else None
        self._type = _TYPES.get(codec.type_name(said), named)
        self._exact = self._type is not None and said == codec.encoding(self._type)
        # A free table may hold what JSON has no word for, as the infinity that was asked for.
        self._free = self._type is not None and any(
            isinstance(field.type, inspect.DictType) for field in fields(self._type)
        )

    def stored(self, payload: bytes) -> Stored:
        """The message in the best form that keeps all of it."""
        if (message := self._typed(payload)) is not None:
            data = msgspec.json.encode(message)
            if not self._free or restored(data, packed=True) == payload:
                return Stored(JSON, True, data, message)
        if (table := _as_json(payload)) is not None:
            return Stored(JSON, True, table)
        if self._is_json_table(payload):
            return Stored(JSON, False, payload)
        packed = self._said.startswith("application/msgpack")
        return Stored(MSGPACK if packed else self._said, False, payload)

    def _typed(self, payload: bytes) -> Struct | None:
        if self._type is None:
            return None
        try:
            message: Struct = codec.decode(self._type, payload, self._said)
        except Invalid:
            return None
        # What a stranger has put beside our fields would be lost.
        if self._exact:
            return message
        names = {field.encode_name for field in fields(self._type)}
        return None if msgspec.msgpack.decode(payload).keys() - names else message

    def _is_json_table(self, payload: bytes) -> bool:
        if not (self._said.startswith(_JSON_ENCODINGS) or payload[:1] == b"{"):
            return False
        try:
            return isinstance(msgspec.json.decode(payload), dict)
        except _BAD:
            return False


def restored(data: bytes, *, packed: bool) -> bytes:
    """The payload that a message had on the bus."""
    return msgspec.msgpack.encode(msgspec.json.decode(data)) if packed else data


def _as_json(payload: bytes) -> bytes | None:
    """A map of MessagePack as JSON, where that loses nothing."""
    try:
        value = msgspec.msgpack.decode(payload)
        if not isinstance(value, dict):
            return None
        data = msgspec.json.encode(value)
        return data if restored(data, packed=True) == payload else None
    except _BAD:
        return None
