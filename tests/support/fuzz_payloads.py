"""Hostile payloads: random, mutated, or well-formed with wrong contents."""

import math
import random
from collections.abc import Callable
from typing import Any

import msgspec

from tests.support.bare import pack

NODES = ("hub", "dynamics", "pressure", "safety")
TOPICS = ("pose", "sensors/pressure", "safety/state", "input/position_request", "input/position")
SOUND: dict[str, dict[str, Any]] = {
    "goto": {"x": 1.0, "y": -0.5, "z": 1.0, "replace": True},
    "toggle_cage": {"cage_on": True},
    "calibrate_pressure": {"zero": True},
    "hold": {},
    "reset": {},
    **{f"{node}/get_params": {"names": []} for node in NODES},
    **{f"{node}/set_params": {"values": {}} for node in NODES},
}
"""Valid request of every service."""


def _coordinate(value: Any) -> bool:
    return type(value) in {int, float} and -10_000 <= value <= 10_000


def _boolean(value: Any) -> bool:
    return type(value) is bool


def _texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(text, str) for text in value)


def _named(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(name, str) for name in value)


FIELDS: dict[str, Callable[[Any], bool]] = {
    "x": _coordinate, "y": _coordinate, "z": _coordinate, "replace": _boolean,
    "cage_on": _boolean, "zero": _boolean, "names": _texts, "values": _named,
}  # fmt: skip


def can_be(service: str, payload: bytes) -> bool:
    """Return whether the bytes are a valid request, judged without the system's own types."""
    try:
        request = msgspec.msgpack.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, ValueError):
        return False
    sound = SOUND[service]
    if not isinstance(request, dict) or not set(request) <= set(sound):
        return False
    needed = set(sound) - {"replace"}
    return needed <= set(request) and all(FIELDS[name](request[name]) for name in request)


def payload(rng: random.Random, sound: dict[str, Any]) -> bytes:
    """Return a payload that is wrong in a random way, and rarely valid by chance."""
    kind = rng.randrange(5)
    if kind == 0:
        return rng.randbytes(rng.randrange(80))
    if kind == 1:
        return _mutated(rng, pack(sound))
    if kind == 2:
        return pack(_value(rng, 3))
    changed = dict(sound)
    name = rng.choice([*sound, "x", "more", ""])
    if kind == 3 and sound:
        changed.pop(name, None)
    changed[rng.choice([*sound, "more"])] = _value(rng, 2)
    return pack(changed)


def _mutated(rng: random.Random, sound: bytes) -> bytes:
    bytes_ = bytearray(sound)
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(bytes_) + 1)
        match rng.randrange(4):
            case 0 if at < len(bytes_):
                bytes_[at] ^= 1 << rng.randrange(8)
            case 1:
                del bytes_[at : at + rng.randrange(5)]
            case 2:
                bytes_[at:at] = rng.randbytes(rng.randrange(5))
            case _:
                bytes_ += bytes_[at:]
    return bytes(bytes_)


def _value(rng: random.Random, depth: int) -> Any:
    plain = (
        math.nan, math.inf, -math.inf, 1e300, -1e300, 10_000.000001, 5e-324, -0.0, 0, -1, 2**63 - 1,
        2**64 - 1, -(2**63), True, False, None, "", "\0", "x" * 5000, b"", b"\xff" * 40,
        msgspec.msgpack.Ext(5, b"ext"), msgspec.Raw(b"\x91" * 2000 + b"\xc0"), msgspec.Raw(b"\xc1"),
    )  # fmt: skip
    kind = rng.randrange(8) if depth else 0
    if kind == 6:
        return [_value(rng, depth - 1) for _ in range(rng.randrange(4))]
    if kind == 7:
        return {rng.choice("xyzq"): _value(rng, depth - 1) for _ in range(rng.randrange(4))}
    return rng.choice(plain)
