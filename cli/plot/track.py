"""Tracks of a flight by vehicle, gathered from its messages."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from msgspec import Struct

from quadctl.schemas.messages import (
    CageSize,
    Called,
    Pose,
    Position,
    Pressure,
    SafetyState,
    Waypoint,
)
from quadctl.schemas.topics import GOTO, POSE, PRESSURE, REQUEST, STATE, called, topic_of
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid


class Spot(NamedTuple):
    """Requested position (m) at a time (s)."""

    at: float
    x: float
    y: float
    z: float


class Phase(NamedTuple):
    """State of safety and its cage from a time (s) on."""

    at: float
    state: str
    cage_on: bool
    cage: CageSize


class Track:
    """Flight of one vehicle in simulated s; a new boot goes on at the end of the previous one."""

    def __init__(self) -> None:
        self.legs: list[list[tuple[float, float, float, float]]] = []  # time, x, y, z by boot
        self.air: list[tuple[float, float, float]] = []  # time, published pressure, baseline, hPa
        self.phases: list[Phase] = []
        self.accepted: list[Spot] = []
        self.refused: list[Spot] = []
        self.boots: list[float] = []
        self.end = 0.0  # time (s) of the latest pose
        self._boot, self._base = "", 0.0
        self._goal: Position | None = None
        self._requested: Waypoint | None = None

    @property
    def path(self) -> list[tuple[float, float, float, float]]:
        """Return time and position, m, of all boots."""
        return [point for leg in self.legs for point in leg]

    def add(self, message: Struct) -> None:
        """Take a message of this vehicle."""
        match message:
            case Pose():
                self._add_pose(message)
            case Pressure():
                at = self._base + message.stamp
                if at <= self.end + 1:  # else it belongs to the previous boot
                    self.air.append((at, message.pressure, message.baseline))
            case SafetyState() if message.boot == self._boot:
                self._add_state(message)
            case Waypoint():
                self._requested = message
            case Called() if message.service == GOTO.name:
                self._add_call(message)

    def _add_pose(self, pose: Pose) -> None:
        if pose.boot != self._boot:
            if self._boot:
                self._base = self.end
                self.boots.append(self.end)
            self._boot = pose.boot
            self.legs.append([])
        self.end = max(self.end, self._base + pose.stamp)
        p = pose.position
        self.legs[-1].append((self.end, p.x, p.y, p.z))

    def _add_state(self, state: SafetyState) -> None:
        at = max(self._base + state.stamp, self.phases[-1].at if self.phases else 0.0)
        phase = Phase(at, state.state, state.cage_on, state.cage)
        if not self.phases or self.phases[-1][1:] != phase[1:]:
            self.phases.append(phase)
        if (goal := self._requested) is not None and state.state != "VERIFYING":
            # Only the state carries the verdict on a waypoint.
            if state.reason:
                self.refused.append(Spot(at, goal.x, goal.y, goal.z))
            self._requested = None
        # Safety also sets goals itself, e.g. for the take-off, without a request.
        if state.state == "MOVING" and state.goal != self._goal:
            self._goal = state.goal
            self.accepted.append(Spot(at, state.goal.x, state.goal.y, state.goal.z))

    def _add_call(self, call: Called) -> None:
        if call.response.get("accepted") is False:
            x, y, z = (float(call.request[axis]) for axis in "xyz")
            self.refused.append(Spot(self.end, x, y, z))


class RecordedFlight:
    """Tracks of all vehicles, by name."""

    def __init__(self) -> None:
        self.tracks: dict[str, Track] = {}

    def add(self, key: str, payload: bytes, encoding: str) -> None:
        """Take a message of any key; skip a foreign or unreadable one."""
        topic: Any = topic_of(key)
        if topic is None:
            return
        try:
            message = codec.decode(topic.type, payload, encoding)
        except Invalid:
            return
        vehicle = key.partition("/")[0]
        self.tracks.setdefault(vehicle, Track()).add(message)

    def flown(self) -> dict[str, Track]:
        """Return the tracks of the vehicles that have a path."""
        return {name: track for name, track in self.tracks.items() if track.legs}


def wanted(vehicles: Iterable[str]) -> list[str]:
    """Return the keys to subscribe to for a picture."""
    topics = (POSE, PRESSURE, STATE, REQUEST, called(GOTO))
    return [topic.key(vehicle) for vehicle in vehicles for topic in topics]
