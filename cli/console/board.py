"""What the console knows of one vehicle: the newest of all it heard, and the last minute. Pure."""

from collections import deque
from typing import Any, NamedTuple

from cli.console.verdicts import Verdict, told
from schemas.messages import Pose, Position, Pressure, SafetyState
from services.runtime.run_files import ProcessRecord

TICK = 0.1
"""Seconds between two samples, and between two pictures that a page is sent."""
_KEPT = 600
_REFUSED_KEPT = 8
_VERDICTS_KEPT = 60


class Sample(NamedTuple):
    """One point of the trail and the plots: simulated time (s), metres, hPa.

    `pressure` is None where no new reading came.
    """

    number: int
    stamp: float
    x: float
    y: float
    z: float
    pressure: float | None
    baseline: float


class Glance(NamedTuple):
    """What the slower parts of a page show; `noted` counts the log's lines ever written."""

    state: SafetyState | None
    nodes: tuple[ProcessRecord, ...]
    values: dict[str, Any]
    verdicts: tuple[Verdict, ...]
    noted: int


class Board:
    """All of it; `epoch` counts the simulation's boots seen, with each of which the past goes."""

    def __init__(self, vehicle: str) -> None:
        self.vehicle = vehicle
        self.problem = "connecting"
        self.pose: Pose | None = None
        self.state: SafetyState | None = None
        self.reading: Pressure | None = None
        self.samples: deque[Sample] = deque(maxlen=_KEPT)
        self.refused: deque[Position] = deque(maxlen=_REFUSED_KEPT)
        self.verdicts: deque[Verdict] = deque(maxlen=_VERDICTS_KEPT)
        self.verified, self.noted, self.epoch = 0, 0, 0
        self.silence = 0.0
        self.nodes: list[ProcessRecord] = []
        self.values: dict[str, Any] = {}
        self._number = 0
        self._asked: Position | None = None

    def hear_state(self, now: SafetyState) -> None:
        """Take the automaton's state, and write down what it tells."""
        if now.state == "VERIFYING":
            self.verified += 1
        for kind, text in told(self.state, now):
            self.note(now.stamp, kind, text)
            if kind == "refused" and self._asked is not None:
                self.refuse(self._asked)
            if kind in {"accepted", "refused"}:
                self._asked = None
        if self.state is not None and now.boot != self.state.boot:
            self.refused.clear()
        self.state = now

    def ask(self, goal: Position) -> None:
        """Take a waypoint that somebody published, whose verdict the state will tell."""
        self._asked = goal

    def refuse(self, goal: Position) -> None:
        """Take a goal that safety refused."""
        if goal in self.refused:
            self.refused.remove(goal)
        self.refused.append(goal)

    def note(self, stamp: float, kind: str, text: str) -> None:
        """Write a line into the log, at a simulated time (s)."""
        self.noted += 1
        self.verdicts.appendleft(Verdict(stamp, kind, text))

    def tick(self, pose: Pose | None, reading: Pressure | None) -> None:
        """Take the newest pose and reading of the last tenth of a second; None where none came."""
        self.silence = 0.0 if pose is not None else self.silence + TICK
        if reading is not None:
            self.reading = reading
        if pose is None:
            return
        if self.pose is not None and pose.boot != self.pose.boot:
            self.samples.clear()
            self.epoch += 1
        self.pose, at = pose, pose.position
        self._number += 1
        self.samples.append(
            Sample(
                self._number, pose.stamp, at.x, at.y, at.z,
                None if reading is None else reading.pressure,
                self.reading.baseline if self.reading else 0.0,
            )
        )  # fmt: skip

    def glance(self) -> Glance:
        """A copy that stays as it is."""
        verdicts = tuple(self.verdicts)
        return Glance(self.state, tuple(self.nodes), dict(self.values), verdicts, self.noted)
