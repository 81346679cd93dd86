"""MessagePack with a schema digest, error replies, and any payload as plain data."""

import math
import threading
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from quadctl.schemas.services import Call, Error
from quadctl.schemas.typeinfo import schema_hash
from quadctl.services.runtime.errors import WIRE_ERRORS, Invalid, QuadctlError, SchemaMismatch

_DEEPEST = 100
"""Levels of nesting that are shown; JSON readers take that many, and people do not."""


def to_jsonable(payload: bytes, said: str) -> Any:
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

encode = msgspec.msgpack.encode

_building = threading.Lock()
"""msgspec shows a type that is half built to a second thread, whose process then crashes."""


@cache
def digest(type_: type[Struct]) -> str:
    """The first 8 hex digits of the digest of a type's schema; safe to ask from any thread."""
    with _building:
        return schema_hash(type_)


@cache
def encoding(type_: type[Struct]) -> str:
    """The Zenoh encoding of a type, as `application/msgpack;quadctl.Pose#0a1b2c3d`."""
    return f"{PREFIX}{type_.__name__}#{digest(type_)}"


@cache
def _decoder(type_: type[M]) -> msgspec.msgpack.Decoder[M]:
    with _building:
        return msgspec.msgpack.Decoder(type_)


@cache
def _error_decoder() -> msgspec.json.Decoder[Error]:
    with _building:
        return msgspec.json.Decoder(Error)


def decode(type_: type[M], payload: bytes, said: str) -> M:
    """Check the sender's encoding and decode.

    An encoding of `type_` with another digest is refused; one without a digest is decoded and
    checked field by field. Raises SchemaMismatch or Invalid.
    """
    check_schema(type_, said)
    return decode_fields(type_, payload)


def decode_fields(type_: type[M], payload: bytes) -> M:
    """Decode what a sender of this very schema has sent; raises Invalid."""
    try:
        message: M = _decoder(type_).decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Invalid(
            f"not a valid {type_.__name__}: {error}",
            f"`quadctl type show {type_.__name__}` prints its fields",
        ) from error
    return message


def is_typed(said: str) -> bool:
    """Whether a sender's encoding names one of our types."""
    return said.startswith(PREFIX)


def type_name(said: str) -> str:
    """The name of our type in a sender's encoding, empty where there is none."""
    return said.removeprefix(PREFIX).partition("#")[0] if is_typed(said) else ""


def check_schema(type_: type[Struct], said: str) -> None:
    """Raise SchemaMismatch where the sender's encoding names another type or digest."""
    if said == encoding(type_) or not is_typed(said):
        return
    name, _, theirs = said.removeprefix(PREFIX).partition("#")
    if name != type_.__name__ or (theirs and theirs != digest(type_)):
        ours = encoding(type_).removeprefix(PREFIX)
        raise SchemaMismatch(
            f"schema mismatch: the sender has {name}#{theirs}, this side has {ours}",
            "install the same version of quadctl on both sides",
        )


def encode_error(error: QuadctlError) -> bytes:
    """An error as the JSON payload of an error reply."""
    code = error.code if error.code in WIRE_ERRORS else "internal"
    return msgspec.json.encode(Error(code, error.message, error.hint))  # type: ignore[arg-type]


def decode_error(payload: bytes) -> QuadctlError:
    """The exception that an error reply stands for."""
    try:
        said = _error_decoder().decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        return Invalid(f"the error reply cannot be read: {error}")
    return WIRE_ERRORS[said.code](said.message, said.hint)


def decode_call(attachment: bytes | None) -> Call | None:
    """The id and deadline of a command, None where it carries none; raises Invalid."""
    return None if attachment is None else decode(Call, attachment, "")


def unreadable(key: str, problem: Invalid) -> Invalid:
    """Why a message that came on a key cannot be read."""
    return Invalid(f"{key}: {problem.message}", problem.hint)
