"""Recordings made without a bus."""

from pathlib import Path
from typing import Any

import msgspec

from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Called,
    Pose,
    Position,
    Pressure,
    Quaternion,
    SafetyState,
    Velocity,
)
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.streams import RawMessage
from quadctl.services.runtime.recording.writer import BagWriter, Outfile

SECOND = 1_000_000_000
BEGAN = 1_800_000_000 * SECOND


def pose(seq: int, *, boot: str = "b0", x: float = 0.1, z: float = 1.0) -> Pose:
    return Pose(
        boot, seq, seq / 100, Position(x * seq, -0.1, z), Velocity(0.1, 0.0, 0.0),
        Quaternion(1.0, 0.0, 0.0, 0.0), BodyRates(0.0, 0.0, 1e-17),
    )  # fmt: skip


def state(stamp: float, **changes: Any) -> SafetyState:
    whole = SafetyState(
        "b0", stamp, 0, "HOVERING", Position(0.0, 0.0, 1.0), True, CageSize(5.0, 5.0, 2.0), ""
    )
    return msgspec.structs.replace(whole, **changes)


def refused(x: float, y: float, z: float) -> Called:
    asked = {"x": x, "y": y, "z": z, "replace": False}
    answer = {"accepted": False, "reason": "outside the cage"}
    return Called("b0", 1.0, "goto", False, asked, answer, "")


def pressure(stamp: float, baseline: float = 0.0) -> Pressure:
    return Pressure(stamp, 1013.0 - baseline, baseline, 0, 0.0)


def raw_message(key: str, message: Any, at: float, encoding: str | None = None) -> RawMessage:
    """Return a message as received from the bus, some seconds after the start of the recording."""
    payload = message if isinstance(message, bytes) else codec.encode(message)
    type_: Any = type(message)
    encoding = codec.encoding(type_) if encoding is None else encoding
    received = BEGAN + round(at * SECOND)
    return RawMessage(key, payload, encoding, received, received - 1000)


def flight(poses: int = 100) -> list[RawMessage]:
    """Return the messages of a short flight, including some with an unknown key."""
    found = [raw_message("uav/safety/state", state(0.0), 0.0)]
    for seq in range(poses):
        found.append(raw_message("uav/pose", pose(seq), seq / 100))
        if seq % 10 == 0:
            found.append(raw_message("uav/sensors/pressure", pressure(seq / 100), seq / 100))
            found.append(raw_message("my/own", b"\x00\xff raw", seq / 100, "zenoh/bytes"))
    return found


def write(path: Path, messages: list[RawMessage], every: int = 25, *, whole: bool = True) -> Path:
    """Write a recording with a chunk every `every` messages, with or without its index."""
    bag = BagWriter(Outfile.create(path), path.parent)
    bag.note("quadctl", {"vehicle": "uav"})
    for count, message in enumerate(messages, start=1):
        bag.add(message)
        if count % every == 0:
            bag.flush()
    if whole:
        bag.finish()
    bag.close()
    return path
