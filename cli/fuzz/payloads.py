"""Payloads that nobody may take: made from a valid one, or from nothing. Pure.

What a mutation has left valid by chance is not among them: it is decoded here as the nodes do.
"""

import random
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import msgspec
from msgspec import Struct, inspect

from services.runtime.bus import codec
from services.runtime.errors import Invalid

_ODD: tuple[Any, ...] = (
    float("nan"), float("inf"), float("-inf"), 1e308, -10_000.001, 2**64 - 1, -(2**63), True, None,
    "", "nan", "x" * 5_000, b"\xff\x00", [], [1.0], {}, {"x": 1.0},
)  # fmt: skip
_DEEP = 3_000
_NOWHERE = "application/msgpack;quadctl."
_ENCODINGS = (
    f"{_NOWHERE}Pose#00000000", f"{_NOWHERE}Nonsense#12345678", f"{_NOWHERE}#", _NOWHERE,
)  # fmt: skip


class Payload(NamedTuple):
    """What is sent: bytes, the encoding that goes with them, and a call's attachment."""

    data: bytes
    encoding: str
    attachment: bytes | None = None


def refused(type_: type[Struct], draw: random.Random, *, called: bool = True) -> Iterator[Payload]:
    """Payloads without end, none of which a reader of the type may take.

    Those of a service that is `called` may have an attachment, too.
    """
    ways = _WAYS if called else _WAYS[:-1]
    example = msgspec.to_builtins(_example(inspect.type_info(type_)))
    while True:
        payload = draw.choice(ways)(type_, example, draw)
        if not _is_valid(type_, payload):
            yield payload


def _is_valid(type_: type[Struct], payload: Payload) -> bool:
    try:
        codec.decode(type_, payload.data, payload.encoding)
        codec.decode_call(payload.attachment)
    except Invalid:
        return False
    return True


def _noise(type_: type[Struct], _example: Any, draw: random.Random) -> Payload:
    return Payload(draw.randbytes(draw.randrange(200)), codec.encoding(type_))


def _flipped(type_: type[Struct], example: Any, draw: random.Random) -> Payload:
    data = bytearray(codec.encode(example))
    for _ in range(draw.randint(1, 4)):
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    return Payload(bytes(data), codec.encoding(type_))


def _cut_or_longer(type_: type[Struct], example: Any, draw: random.Random) -> Payload:
    data = codec.encode(example)
    data = data[: draw.randrange(len(data))] if draw.random() < 0.5 else data + draw.randbytes(3)
    return Payload(data, codec.encoding(type_))


def _odd_field(type_: type[Struct], example: Any, draw: random.Random) -> Payload:
    return Payload(codec.encode(_with_odd(example, draw)), codec.encoding(type_))


def _with_odd(value: Any, draw: random.Random) -> Any:
    """The same with something else in one place, or a field too many or too few."""
    if not isinstance(value, dict) or not value or draw.random() < 0.2:
        return draw.choice(_ODD)
    name = draw.choice(list(value))
    match draw.randrange(6):
        case 0:
            return {other: kept for other, kept in value.items() if other != name}
        case 1:
            return value | {"stranger": draw.choice(_ODD)}
        case _:
            return value | {name: _with_odd(value[name], draw)}


def _deep(type_: type[Struct], _example: Any, draw: random.Random) -> Payload:
    return Payload(draw.choice((b"\x91", b"\x81\xa1x")) * _DEEP, codec.encoding(type_))


def _mislabelled(_type: type[Struct], example: Any, draw: random.Random) -> Payload:
    return Payload(codec.encode(example), draw.choice(_ENCODINGS))


def _bad_attachment(type_: type[Struct], example: Any, draw: random.Random) -> Payload:
    call = {"id": "fuzz", "deadline": 4e9} | {draw.choice(("id", "deadline")): draw.choice(_ODD)}
    attachment = (
        codec.encode(call) if draw.random() < 0.5 else draw.randbytes(draw.randrange(1, 60))
    )
    return Payload(codec.encode(example), codec.encoding(type_), attachment)


_WAYS: tuple[Callable[[type[Struct], Any, random.Random], Payload], ...] = (
    _noise, _flipped, _cut_or_longer, _odd_field, _odd_field, _deep, _mislabelled, _bad_attachment,
)  # fmt: skip


def _example(type_: inspect.Type) -> Any:
    """A valid value of a type of the wire."""
    match type_:
        case inspect.Metadata():
            return _example(type_.type)
        case inspect.StructType():
            return {field.encode_name: _example(field.type) for field in type_.fields}
        case inspect.LiteralType():
            return type_.values[0]
        case inspect.UnionType():
            return _example(type_.types[0])
        case inspect.BoolType():
            return True
        case inspect.IntType():
            return 1
        case inspect.FloatType():
            return 0.5
        case inspect.StrType():
            return "a"
        case inspect.ListType():
            return []
        case inspect.DictType():
            return {}
    return None
