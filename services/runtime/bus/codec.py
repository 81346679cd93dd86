"""MessagePack with a schema digest, error replies, and any payload as plain data."""

import math
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from quadctl.schemas.digests import DIGESTS, go_together, place
from quadctl.schemas.services import Call, Error
from quadctl.schemas.typed import BUILDING, json_decoder
from quadctl.services.runtime.errors import WIRE_ERRORS, Invalid, QuadctlError, SchemaMismatch
from quadctl.services.runtime.nesting import is_too_deep

UNREADABLE = msgspec.DecodeError, UnicodeDecodeError, RecursionError
"""Errors of a decoder."""


def to_jsonable(payload: bytes, encoding: str) -> Any:
    """Return MessagePack and JSON as data, text as text, anything else as hex.

    The `encoding` selects the reader; without a known one, the first that succeeds. Values
    that JSON lacks become text: bytes hex, NaN and the infinities `nan`, `inf` and `-inf`, a time
    ISO 8601, an extension `{"ext": its code, "data": hex}`, and a map's keys text.
    """
    for attempt in _READERS.get(encoding.partition(";")[0], _ANY):
        try:
            value = attempt(payload)
        except UNREADABLE:
            continue
        if not is_too_deep(value):
            return _carried(value)
    return payload.hex()


def _carried(value: Any) -> Any:
    """Convert a value to JSON types."""
    match value:
        case dict():
            return _table(value)
        case list() | tuple():
            return [_carried(item) for item in value]
        case bytes():
            return value.hex()
        case float() if not math.isfinite(value):
            return str(value)
        case msgspec.msgpack.Ext():
            return {"ext": value.code, "data": bytes(value.data).hex()}
    return msgspec.to_builtins(value)  # a time becomes text


def _table(value: dict[Any, Any]) -> Any:
    carried = {_key(name): _carried(item) for name, item in value.items()}
    if len(carried) == len(value):
        return carried
    # 1 and "1" are the same name in JSON; pairs keep both.
    return [[_carried(name), _carried(item)] for name, item in value.items()]


def _key(name: Any) -> str:
    return name if isinstance(name, str) else msgspec.json.encode(_carried(name)).decode()


def _text(payload: bytes) -> str:
    text = payload.decode()
    if any(ord(char) < ord(" ") and char not in "\t\r\n" for char in text):
        raise UnicodeDecodeError("utf-8", payload, 0, 1, "control character")
    return text


Reader = Callable[[bytes], Any]
_READERS: dict[str, tuple[Reader, ...]] = {
    "application/msgpack": (msgspec.msgpack.decode,),
    "application/json": (msgspec.json.decode,),
    "text/json": (msgspec.json.decode,),
}
_ANY: tuple[Reader, ...] = (msgspec.json.decode, _text, msgspec.msgpack.decode)


M = TypeVar("M", bound=Struct)

ERROR_ENCODING = "application/json;quadctl.Error"
PREFIX = "application/msgpack;quadctl."

_PLAIN: Any = dict
"""Type of a table without a schema, for a service of another author."""

encode = msgspec.msgpack.encode


@cache
def digest(type_: type[Struct]) -> str:
    """Return 8 hex digits of a schema, and those of its earlier versions; safe to call from any thread."""
    if known := DIGESTS.get(place(type_)):
        return known
    from quadctl.schemas.typeinfo import schema_hash

    return schema_hash(type_)


@cache
def encoding(type_: type[Struct]) -> str:
    """Return the Zenoh encoding of a type, e.g. `application/msgpack;quadctl.Pose#0a1b2c3d`.

    A plain table (dict) goes without a type: any schema that it fits takes it.
    """
    if type_ is _PLAIN:
        return "application/msgpack"
    return f"{PREFIX}{type_.__name__}#{digest(type_)}"


@cache
def decoder(type_: type[M]) -> msgspec.msgpack.Decoder[M]:
    """Return the decoder of a type, which raises UNREADABLE; `decode_fields` raises Invalid in their place."""
    with BUILDING:
        return msgspec.msgpack.Decoder(type_, ext_hook=_refuse_extension)


def _refuse_extension(code: int, _data: memoryview) -> Any:
    # No schema has one, and the call log could not publish it.
    raise msgspec.ValidationError(f"it has an extension type of MessagePack, code {code}")


@cache
def _error_decoder() -> Any:
    return json_decoder(Error)


def decode(type_: type[M], payload: bytes, encoding: str) -> M:
    """Check the sender's encoding and decode; raise SchemaMismatch or Invalid.

    Another digest of `type_` is refused unless one side's version follows the other's; without a
    digest the fields are checked one by one.
    """
    check_schema(type_, encoding)
    try:
        return decode_fields(type_, payload)
    except Invalid as error:
        if _digest_in(encoding).partition(".")[0] in {"", *digest(type_).split(".")}:
            raise
        raise Invalid(error.message, _NEWER) from error


_NEWER = "the sender's quadctl is newer: leave that field at its default, or install it here, too"


def _digest_in(encoding: str) -> str:
    return encoding.removeprefix(PREFIX).partition("#")[2] if is_typed(encoding) else ""


def decode_fields(type_: type[M], payload: bytes) -> M:
    """Decode a message of a sender with this very schema; raise Invalid if it is not valid."""
    try:
        message: M = decoder(type_).decode(payload)
    except UNREADABLE as error:
        name = type_.__name__
        ours = type_.__module__.startswith("quadctl.schemas.")
        hint = (
            f"`quadctl type show {name}` prints its fields" if ours else f"see {name} in its node"
        )
        raise Invalid(f"not a valid {name}: {error}{_found(payload, error)}", hint) from error
    return message


def _found(payload: bytes, error: Exception) -> str:
    """Return the number that an error of msgspec is about; it names the field alone."""
    path = str(error).partition(" - at `$.")[2].rstrip("`")
    with suppress(*UNREADABLE, LookupError, TypeError):
        value = msgspec.msgpack.decode(payload)
        for name in path.split(".") if path else ():
            value = value[name]
        if isinstance(value, int | float):
            return f": it is {value!r}"
    return ""


def is_typed(encoding: str) -> bool:
    """Return whether a sender's encoding names one of our types."""
    return encoding.startswith(PREFIX)


def type_name(encoding: str) -> str:
    """Return the name of our type in a sender's encoding; empty if there is none."""
    return encoding.removeprefix(PREFIX).partition("#")[0] if is_typed(encoding) else ""


def check_schema(type_: type[Struct], sent_encoding: str) -> None:
    """Raise SchemaMismatch if the sender's encoding names another type, or a version that does not fit."""
    if type_ is _PLAIN or sent_encoding == encoding(type_) or not is_typed(sent_encoding):
        return
    name, theirs = type_name(sent_encoding), _digest_in(sent_encoding)
    if name != type_.__name__ or (theirs and not go_together(theirs, digest(type_))):
        ours = encoding(type_).removeprefix(PREFIX)
        raise SchemaMismatch(
            f"schema mismatch: the sender has {name}#{theirs}, this side has {ours}",
            "install the same version of quadctl on both sides",
        )


def encode_error(error: QuadctlError) -> bytes:
    """Encode an error as the JSON payload of an error reply."""
    code = error.code if error.code in WIRE_ERRORS else "internal"
    return msgspec.json.encode(Error(code, error.message, error.hint))  # type: ignore[arg-type]


def decode_error(payload: bytes) -> QuadctlError:
    """Return the exception of an error reply."""
    try:
        sent = _error_decoder().decode(payload)
    except UNREADABLE as error:
        return Invalid(f"the error reply cannot be read: {error}")
    return WIRE_ERRORS[sent.code](sent.message, sent.hint)


def decode_call(attachment: bytes | None) -> Call | None:
    """Return the id and deadline of a command, None without an attachment; raise Invalid."""
    return None if attachment is None else decode(Call, attachment, "")


def unreadable(key: str, problem: Invalid) -> Invalid:
    """Return the error for an unreadable message on a key."""
    return Invalid(f"{key}: {problem.message}", problem.hint)
