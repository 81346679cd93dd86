"""The record of a flight and its digests, equal for equal flights. Pure.

Excluded is all that differs from run to run or from version to version: the boot's name, the count
of requests before it, and the wording of reasons.
"""

import hashlib
import struct
from typing import Any

import msgspec

from quadctl.schemas.messages import Pose, Pressure, SafetyState, without_wording
from quadctl.schemas.topics import period
from quadctl.services.runtime.errors import QuadctlError

_POSE = struct.Struct("<Q14d")
_PRESSURE = struct.Struct("<3dQd")


class Record:
    """Every pose, every transition of safety and every reading of one boot, up to a time."""

    def __init__(self, boot: str, end: float, pressure_rate: float) -> None:
        """Of the boot of that name until `end` (s), with so many readings per second."""
        self.stamp = -1.0
        """Simulated time, s, that the flight has come to; before its first pose -1."""
        self._boot, self._end, self._rate = boot, end, pressure_rate
        self._poses: list[bytes] = []
        self._states: list[SafetyState] = []
        self._readings: list[Pressure] = []
        self._due: list[float] = []

    def add(self, message: Pose | SafetyState | Pressure) -> None:
        """Take a message where it belongs to the flight.

        Raises QuadctlError where a pose was lost, or another boot has begun.
        """
        if isinstance(message, Pressure):
            self._read(message)
        elif isinstance(message, SafetyState):
            self._tell(message)
        else:
            self._fly(message)

    def check(self) -> None:
        """Raise QuadctlError where the record is not whole."""
        read = [reading.stamp for reading in self._readings]
        if self.stamp < self._end or read != self._due:
            raise QuadctlError(
                f"of {len(self._due)} readings of the barometer {len(read)} came: the record is"
                " not whole",
                "too much else runs on this machine; fly again",
            )

    def document(self) -> dict[str, Any]:
        """The SHA-256 of each log, of all three in `hash`, and how long they are."""
        poses = _digest(self._poses)
        states = [without_wording(self._timeless(state)) for state in self._states]
        transitions = _digest([msgspec.msgpack.encode(state) for state in states])
        pressure = _digest([_PRESSURE.pack(*msgspec.structs.astuple(r)) for r in self._readings])
        return {
            "hash": _digest([text.encode() for text in (poses, transitions, pressure)]),
            "poses": poses,
            "transitions": transitions,
            "pressure": pressure,
            "counts": {
                "poses": len(self._poses),
                "transitions": len(self._states),
                "pressure": len(self._readings),
            },
        }

    def _fly(self, pose: Pose) -> None:
        seen = len(self._poses)
        if pose.boot != self._boot:
            if not seen:
                return
            raise QuadctlError(
                f"the simulation began anew after {self.stamp:g} s",
                "who called reset, or did dynamics die? `quadctl status`",
            )
        # In lock-step a pose that is not answered is published again.
        if self.stamp >= self._end or pose.seq == seen - 1:
            return
        if pose.seq != seen:
            raise QuadctlError(
                f"the poses {seen} to {pose.seq - 1} were lost on their way here: the record is"
                " not whole",
                "too much else runs on this machine; fly again",
            )
        p, v, q, w = pose.position, pose.velocity, pose.orientation, pose.body_rates
        self._poses.append(
            _POSE.pack(
                pose.seq, pose.stamp, p.x, p.y, p.z, v.x, v.y, v.z, q.w, q.x, q.y, q.z, w.x, w.y,
                w.z,
            )
        )  # fmt: skip
        if period(pose.stamp, self._rate) != period(self.stamp, self._rate):
            self._due.append(pose.stamp)
        self.stamp = pose.stamp

    def _tell(self, state: SafetyState) -> None:
        """Keep a transition; a state that differs in stamp or wording alone is none."""
        if state.boot == self._boot and state.stamp <= self._end:
            last = self._states[-1] if self._states else None
            if last is None or _verdict(last) != _verdict(state):
                self._states.append(state)

    def _read(self, reading: Pressure) -> None:
        """A reading; those before the boot's first are of another time."""
        expected = reading.stamp > self._readings[-1].stamp if self._readings else not reading.stamp
        if expected and reading.stamp <= self._end:
            self._readings.append(reading)

    def _timeless(self, state: SafetyState) -> SafetyState:
        first = self._states[0].request
        return msgspec.structs.replace(state, boot="", request=state.request - first)


def _verdict(state: SafetyState) -> tuple[Any, ...]:
    return without_wording(msgspec.structs.replace(state, stamp=0.0))


def _digest(parts: list[bytes]) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(part)
    return whole.hexdigest()
