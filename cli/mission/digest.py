"""Record of a flight and its digests, equal for equal flights. Pure.

Left out is what differs between runs or versions: the boot's name, the count of requests before
it, and the wording of reasons.
"""

import hashlib
import struct
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Protocol

import msgspec

from quadctl.schemas.messages import Pose, Pressure, SafetyState, without_wording
from quadctl.schemas.topics import POSE, PRESSURE, STATE, Topic, period
from quadctl.services.runtime.errors import QuadctlError

_POSE = struct.Struct("<Q14d")
_PRESSURE = struct.Struct("<3dQd")
_SLACK = 1e-6  # s of rounding of a time
_BUSY = "other programs keep this machine too busy; close some and fly again"


class FlightRecord(Protocol):
    """Record of one boot; `stamp` (s) is the time of its latest pose, -1 before the first."""

    topics: ClassVar[tuple[Topic[Any], ...]]
    """Topics of which it takes the messages."""
    stamp: float

    def add(self, message: Any) -> None:
        """Take a message of the flight; raise QuadctlError for one that makes the record worthless."""

    def check(
        self, values: Mapping[str, Any], changes: Iterable[tuple[float, Mapping[str, Any]]]
    ) -> None:
        """Raise QuadctlError if the record is incomplete; arguments as Record.check."""


class Record:
    """Every pose, every transition of safety and every reading of one boot, up to a time."""

    topics: ClassVar[tuple[Topic[Any], ...]] = (POSE, STATE, PRESSURE)

    def __init__(self, boot: str, end: float) -> None:
        """Record the named boot until `end` (s)."""
        self.stamp = -1.0
        """Simulated time (s) of the latest pose; -1 before the first."""
        self._boot, self._end = boot, end
        self._poses: list[bytes] = []
        self._states: list[SafetyState] = []
        self._readings: list[Pressure] = []
        self._stamps: list[float] = []

    def add(self, message: Pose | SafetyState | Pressure) -> None:
        """Take a message of the flight; raise QuadctlError if a pose was lost or a boot began."""
        if isinstance(message, Pressure):
            self._add_reading(message)
        elif isinstance(message, SafetyState):
            self._add_state(message)
        else:
            self._add_pose(message)

    def check(
        self, values: Mapping[str, Any], changes: Iterable[tuple[float, Mapping[str, Any]]] = ()
    ) -> None:
        """Raise QuadctlError if the record is incomplete.

        The readings that are due depend on the parameters: `values` by dotted name at the start,
        and `changes` with their times (s), in order.
        """
        due = list(self._due(dict(values), list(changes)))
        # What came before belongs to another boot.
        del self._readings[: max(0, len(self._readings) - len(due))]
        read = [reading.stamp for reading in self._readings]
        if self.stamp < self._end or read != due:
            raise QuadctlError(
                f"{len(read)} of {len(due)} barometer readings arrived: incomplete record",
                _BUSY,
            )

    def document(self) -> dict[str, Any]:
        """Return the SHA-256 of each log, of all three in `hash`, and the lengths of the logs."""
        poses = _digest(self._poses)
        states = [without_wording(self._without_boot(state)) for state in self._states]
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

    def _add_pose(self, pose: Pose) -> None:
        count = len(self._poses)
        if pose.boot != self._boot:
            if not count:
                return
            raise QuadctlError(
                f"the simulation restarted after {self.stamp:g} s",
                "a reset was called, or dynamics died: `quadctl status`",
            )
        # In lock-step an unanswered pose is published again.
        if self.stamp >= self._end or pose.seq == count - 1:
            return
        if pose.seq != count:
            raise QuadctlError(
                f"the poses {count} to {pose.seq - 1} were lost: incomplete record", _BUSY
            )
        p, v, q, w = pose.position, pose.velocity, pose.orientation, pose.body_rates
        self._poses.append(
            _POSE.pack(
                pose.seq, pose.stamp, p.x, p.y, p.z, v.x, v.y, v.z, q.w, q.x, q.y, q.z, w.x, w.y,
                w.z,
            )
        )  # fmt: skip
        self._stamps.append(pose.stamp)
        self.stamp = pose.stamp

    def _due(
        self, values: dict[str, Any], changes: list[tuple[float, Mapping[str, Any]]]
    ) -> Iterator[float]:
        """Yield the times (s) of the readings that the barometer has to give."""
        last, before = -1, 0.0
        for stamp in self._stamps:
            # A change takes effect after the reading of its pose.
            while changes and changes[0][0] <= before:
                values |= changes.pop(0)[1]
            before, now = stamp, period(stamp, values["pressure.rate"])
            fault = values["pressure.fault.kind"]
            old = fault == "delay" and stamp + _SLACK < values["pressure.fault.delay"]
            if now != last and not (fault == "off" or old) and stamp <= self._end:
                yield stamp
            last = now

    def _add_state(self, state: SafetyState) -> None:
        """Keep a transition; a state that differs only in stamp or wording is none."""
        if state.boot == self._boot and state.stamp <= self._end:
            last = self._states[-1] if self._states else None
            if last is None or _verdict(last) != _verdict(state):
                self._states.append(state)

    def _add_reading(self, reading: Pressure) -> None:
        """Keep a reading in place of those of its time or later, which belong to another boot."""
        while self._readings and self._readings[-1].stamp >= reading.stamp:
            self._readings.pop()
        if reading.stamp <= self._end:
            self._readings.append(reading)

    def _without_boot(self, state: SafetyState) -> SafetyState:
        first = self._states[0].request
        return msgspec.structs.replace(state, boot="", request=state.request - first)


def _verdict(state: SafetyState) -> tuple[Any, ...]:
    return without_wording(msgspec.structs.replace(state, stamp=0.0))


def _digest(parts: list[bytes]) -> str:
    whole = hashlib.sha256()
    for part in parts:
        whole.update(part)
    return whole.hexdigest()
