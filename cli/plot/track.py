"""Tracks of a flight by vehicle, gathered from its messages."""

from collections.abc import Callable
from math import isfinite, nan
from typing import Any, NamedTuple, TypeVar

from msgspec import Struct

from quadctl.schemas.messages import (
    CageSize,
    Called,
    Pose,
    Position,
    Pressure,
    SafetyState,
    Waypoint,
    Zone,
    Zones,
)
from quadctl.schemas.topics import GOTO, POSE, PRESSURE, REQUEST, STATE, ZONES, Topic, called
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


MOST_POINTS = 30_000
"""Points of a curve that are kept; a picture of 1440 pixels shows no more. An hour of poses keeps one
every 0.16 s: in a turn of 1 m at 2 m/s, the line is less than a pixel off."""
_MOST, _MOST_EVENTS = 1000, 100_000
"""Vehicles, and boots of a vehicle, in one picture; states and goals of a vehicle."""

Point = TypeVar("Point")


class Curve(list[Point]):
    """Points in their order, of which ever fewer are kept as they become many; always the last."""

    def __init__(self) -> None:
        super().__init__()
        self.added = 0
        """Points added so far."""
        self._stride = 1

    def add(self, point: Point) -> None:
        """Add a point at the end."""
        if len(self) > 1 and (self.added - 1) % self._stride:
            self[-1] = point
        else:
            self.append(point)
        self.added += 1
        if len(self) > MOST_POINTS:
            del self[1:-1:2]
            self._stride *= 2


class Track:
    """Flight of one vehicle in simulated s; a new boot goes on at the end of the previous one."""

    def __init__(self) -> None:
        self.legs: list[Curve[tuple[float, float, float, float]]] = []  # time, x, y, z by boot
        self.air: Curve[tuple[float, float, float]] = Curve()  # time, pressure, baseline, hPa
        self.phases: list[Phase] = []
        self.accepted: list[Spot] = []
        self.refused: list[Spot] = []
        self.zones: dict[Zone, None] = {}  # all that were ever in force, in their order
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
        """Take a message of this vehicle; raises Invalid if they are too many for a picture."""
        match message:
            case Pose():
                self._add_pose(message)
                return
            case Pressure():
                at = self._base + message.stamp
                if at <= self.end + 1:  # else it belongs to the previous boot
                    self.air.add((at, message.pressure, message.baseline))
            case SafetyState() if message.boot == self._boot:
                self._add_state(message)
            case Waypoint():
                self._requested = message
            case Zones():
                self.zones |= dict.fromkeys(message.zones)
            case Called() if message.service == GOTO.name:
                self._add_call(message)
        events = len(self.phases) + len(self.accepted) + len(self.refused)
        if events + len(self.zones) > _MOST_EVENTS:
            raise _too_many(f"states, goals and zones (at most {_MOST_EVENTS})")

    def _add_pose(self, pose: Pose) -> None:
        if pose.boot != self._boot:
            if self._boot:
                self._base = self.end
                self.boots.append(self.end)
            self._boot = pose.boot
            self.legs.append(Curve())
            if len(self.legs) > _MOST:
                raise _too_many(f"boots (at most {_MOST})")
        self.end = max(self.end, self._base + pose.stamp)
        p = pose.position
        self.legs[-1].add((self.end, p.x, p.y, p.z))

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
            # The table of a call is free: another program may write anything into it.
            goal = [call.request.get(axis) for axis in "xyz"]
            x, y, z = (float(value) if isinstance(value, int | float) else nan for value in goal)
            if isfinite(x + y + z):
                self.refused.append(Spot(self.end, x, y, z))


_DRAWN = {topic.name: topic for topic in (POSE, PRESSURE, STATE, ZONES, REQUEST, called(GOTO))}


def is_drawn(key: str) -> bool:
    """Return whether messages of a key are in a picture."""
    return key.partition("/")[2] in _DRAWN


def drawn(vehicle: str) -> list[str]:
    """Return the keys of a vehicle that are in a picture."""
    return [topic.key(vehicle) for topic in _DRAWN.values()]


class RecordedFlight:
    """Tracks of all vehicles, by name."""

    def __init__(self) -> None:
        self.tracks: dict[str, Track] = {}

    def add(self, key: str, decoded: Callable[[type[Any]], Struct]) -> None:
        """Take a message of a key that is drawn, `decoded` to a type; skip an unreadable one.

        Raises Invalid if there are too many for a picture.
        """
        vehicle, _, name = key.partition("/")
        topic: Topic[Any] = _DRAWN[name]
        try:
            message = decoded(topic.type)
        except Invalid:
            return
        if vehicle not in self.tracks:
            self.tracks[vehicle] = Track()
            if len(self.tracks) > _MOST:
                raise _too_many(f"vehicles (at most {_MOST})")
        self.tracks[vehicle].add(message)

    def flown(self) -> dict[str, Track]:
        """Return the tracks of the vehicles that have a path."""
        return {name: track for name, track in self.tracks.items() if track.legs}


def _too_many(what: str) -> Invalid:
    return Invalid(f"too many {what} for one picture", "`quadctl bag export --csv` writes tables")
