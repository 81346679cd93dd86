"""Messages to bytes and back: MessagePack, with the type and its schema's digest beside it."""

import threading
from functools import cache
from typing import TypeVar

import msgspec
from msgspec import Struct

from schemas.describe import schema_hash
from schemas.envelope import Call, Error
from services.runtime.errors import WIRE_ERRORS, Invalid, QuadctlError, SchemaMismatch

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
