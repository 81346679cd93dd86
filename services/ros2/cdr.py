"""CDR codec of msgspec structs: XCDR1, little-endian, as rmw_zenoh carries messages.

A payload is a header of four bytes, then the fields in order. A number is aligned to its size,
counted from the end of the header. A string is its length with the NUL (uint32), its UTF-8 and a
NUL; a sequence is its count (uint32) and its items; an array is its items alone.
"""

import struct
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

from msgspec import Struct

Bool = Annotated[bool, "?"]
Uint8 = Annotated[int, "B"]
Int32 = Annotated[int, "i"]
Uint32 = Annotated[int, "I"]
Int64 = Annotated[int, "q"]
Uint64 = Annotated[int, "Q"]
Float32 = Annotated[float, "f"]
Float64 = Annotated[float, "d"]
Array36 = Annotated[tuple[float, ...], 36]
"""Fixed array, 36 float64."""

M = TypeVar("M", bound=Struct)


class Malformed(ValueError):
    """Payload that is not CDR of the expected type."""


_HEADER = b"\x00\x01\x00\x00"
_COUNT = struct.Struct("<I")
_PADDING = 3
"""Bytes; a serializer may pad the end of a payload to a multiple of four."""

Write = Callable[[bytearray, Any], None]
Read = Callable[[bytes, int], tuple[Any, int]]


def encode(message: Struct) -> bytes:
    """Return the payload of a message; raise struct.error for a number out of its range."""
    out = bytearray(_HEADER)
    for write in _writers(type(message)):
        write(out, message)
    return bytes(out)


def decode(type_: type[M], payload: bytes) -> M:
    """Return the message of a payload; raise Malformed if it is not one of this type."""
    if payload[: len(_HEADER)] != _HEADER:
        raise Malformed("the payload is not little-endian CDR 1")
    try:
        message, end = _reader(type_)(payload, len(_HEADER))
    except (struct.error, UnicodeDecodeError) as error:
        raise Malformed(f"the payload is no {type_.__name__}: {error}") from error
    if len(payload) - end > _PADDING:
        raise Malformed(f"{len(payload) - end} bytes follow the {type_.__name__}")
    found: M = message
    return found


def _aligned(at: int, size: int) -> int:
    """Return the next position for a number of a size; the header has four bytes."""
    return at + (len(_HEADER) - at) % size


def _pad(out: bytearray, size: int) -> None:
    out.extend(bytes(_aligned(len(out), size) - len(out)))


@cache
def _writers(type_: type[Struct]) -> tuple[Write, ...]:
    """Return the writers of a type: one for each run of numbers of one size, string or sequence."""
    writers: list[Write] = []
    run: list[tuple[str, str]] = []

    def end_run() -> None:
        if run:
            writers.append(_run_writer([path for path, _ in run], "".join(code for _, code in run)))
            run.clear()

    for path, hint in _leaves(type_):
        code = _number(hint)
        if code and (not run or _size(run[0][1]) == _size(code)):
            run.append((path, code))
            continue
        end_run()
        if code:
            run.append((path, code))
        else:
            writers.append(_field_writer(path, _item_writer(hint)))
    end_run()
    return tuple(writers)


def _leaves(type_: type[Struct]) -> list[tuple[str, Any]]:
    """Return the dotted paths and the types of all fields, those of nested structs in place."""
    found: list[tuple[str, Any]] = []
    for name, hint in _fields(type_).items():
        if isinstance(hint, type) and issubclass(hint, Struct):
            found += [(f"{name}.{path}", below) for path, below in _leaves(hint)]
        else:
            found.append((name, hint))
    return found


@cache
def _fields(type_: type[Struct]) -> dict[str, Any]:
    hints = get_type_hints(type_, include_extras=True)
    return {name: hints[name] for name in type_.__struct_fields__}


def _number(hint: Any) -> str:
    """Return the struct code of a number's type; empty for any other type."""
    code = get_args(hint)[1] if get_origin(hint) is Annotated else ""
    return code if isinstance(code, str) else ""


def _size(code: str) -> int:
    return struct.calcsize(f"<{code}")


def _run_writer(paths: list[str], codes: str) -> Write:
    size, pack = _size(codes[0]), struct.Struct(f"<{codes}").pack
    get = attrgetter(*paths)

    def write(out: bytearray, message: Any) -> None:
        _pad(out, size)
        out += pack(*get(message))

    def write_one(out: bytearray, message: Any) -> None:
        _pad(out, size)
        out += pack(get(message))

    return write if len(paths) > 1 else write_one


def _field_writer(path: str, write: Write) -> Write:
    get = attrgetter(path)
    return lambda out, message: write(out, get(message))


def _item_writer(hint: Any) -> Write:
    """Return the writer of a value of a type: a string, bytes, sequence, array, number or struct."""
    if hint is str:
        return _write_string
    if hint is bytes:
        return _write_bytes
    if get_origin(hint) is tuple:
        return _sequence_writer(get_args(hint)[0])
    if get_origin(hint) is Annotated and not _number(hint):
        return _numbers_writer(f"{get_args(hint)[1]}d")
    writers = _writers(hint)

    def write(out: bytearray, message: Any) -> None:
        for each in writers:
            each(out, message)

    return write


def _write_string(out: bytearray, text: str) -> None:
    data = text.encode()
    _pad(out, _COUNT.size)
    out += _COUNT.pack(len(data) + 1)
    out += data
    out += b"\0"


def _write_bytes(out: bytearray, data: bytes) -> None:
    _pad(out, _COUNT.size)
    out += _COUNT.pack(len(data))
    out += data


def _numbers_writer(format_: str) -> Write:
    packer, size = struct.Struct(f"<{format_}"), _size(format_[-1])

    def write(out: bytearray, numbers: tuple[Any, ...]) -> None:
        _pad(out, size)
        out += packer.pack(*numbers)

    return write


def _sequence_writer(hint: Any) -> Write:
    if code := _number(hint):
        size = _size(code)

        def write_numbers(out: bytearray, numbers: tuple[Any, ...]) -> None:
            _pad(out, _COUNT.size)
            out += _COUNT.pack(len(numbers))
            if numbers:  # an empty sequence has no padding after its count
                _pad(out, size)
                out += struct.pack(f"<{len(numbers)}{code}", *numbers)

        return write_numbers
    write_item = _item_writer(hint)

    def write(out: bytearray, items: tuple[Any, ...]) -> None:
        _pad(out, _COUNT.size)
        out += _COUNT.pack(len(items))
        for item in items:
            write_item(out, item)

    return write


@cache
def _reader(type_: type[Struct]) -> Read:
    readers = tuple(_item_reader(hint) for hint in _fields(type_).values())

    def read(data: bytes, at: int) -> tuple[Any, int]:
        values = []
        for each in readers:
            value, at = each(data, at)
            values.append(value)
        return type_(*values), at

    return read


def _item_reader(hint: Any) -> Read:
    if code := _number(hint):
        return _read_bool if code == "?" else _number_reader(code)
    if hint is str:
        return _read_string
    if hint is bytes:
        return _read_bytes
    if get_origin(hint) is tuple:
        return _sequence_reader(_item_reader(get_args(hint)[0]))
    if get_origin(hint) is Annotated:
        return _array_reader(get_args(hint)[1])
    return _reader(hint)


def _number_reader(code: str) -> Read:
    number = struct.Struct(f"<{code}")
    size = number.size

    def read(data: bytes, at: int) -> tuple[Any, int]:
        at = _aligned(at, size)
        return number.unpack_from(data, at)[0], at + size

    return read


def _read_bool(data: bytes, at: int) -> tuple[bool, int]:
    if at >= len(data) or data[at] > 1:
        raise Malformed("a bool is neither 0 nor 1")
    return data[at] == 1, at + 1


def _read_count(data: bytes, at: int) -> tuple[int, int]:
    """Read a count of items of at least one byte each."""
    at = _aligned(at, _COUNT.size)
    count: int = _COUNT.unpack_from(data, at)[0]
    at += _COUNT.size
    if count > len(data) - at:
        raise Malformed(f"a count is {count}, but only {len(data) - at} bytes follow")
    return count, at


def _read_string(data: bytes, at: int) -> tuple[str, int]:
    size, at = _read_count(data, at)
    end = at + size
    if not size:  # some serializers write an empty string without its NUL
        return "", end
    if data[end - 1]:
        raise Malformed("a string has no NUL at its end")
    return data[at : end - 1].decode(), end


def _read_bytes(data: bytes, at: int) -> tuple[bytes, int]:
    size, at = _read_count(data, at)
    return data[at : at + size], at + size


def _sequence_reader(read_item: Read) -> Read:
    def read(data: bytes, at: int) -> tuple[tuple[Any, ...], int]:
        count, at = _read_count(data, at)
        items = []
        for _ in range(count):
            item, at = read_item(data, at)
            items.append(item)
        return tuple(items), at

    return read


def _array_reader(count: int) -> Read:
    numbers = struct.Struct(f"<{count}d")

    def read(data: bytes, at: int) -> tuple[tuple[float, ...], int]:
        at = _aligned(at, 8)
        return numbers.unpack_from(data, at), at + numbers.size

    return read
