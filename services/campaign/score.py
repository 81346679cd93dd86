"""Log, excursion and report of simulated flights.

The digest covers no wording, neither of reasons nor of log lines.

The excursion is the distance of the true position beyond the cage in force. A vehicle that was
inside when the cage came on or changed must not go beyond it. A vehicle that was outside then, or
could no longer stop inside, may go as far as its stopping point at that instant, and never out
again once it has come nearer.
"""

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from math import sqrt
from typing import Any

import numpy as np
from msgspec import Struct, msgpack
from msgspec.structs import replace

from quadctl.schemas.messages import SafetyState, without_wording
from quadctl.services.campaign.watch import Floats


class Flown(Struct, frozen=True):
    """Figures of one flight: worst excursion (m) and its time (s), counts, arrival times (s)."""

    seed: int
    worst: float
    at: float
    transitions: dict[str, int]
    refusals: dict[str, int]
    stops: dict[str, int]
    arrivals: list[float]
    violations: list[str]
    hash: str


class FlightLog:
    """Record of a flight in progress; the writer sets `now` (s)."""

    def __init__(self, *, log: bool) -> None:
        """Start empty; keep lines only with `log`."""
        self.now = 0.0
        self.lines: list[str] = []
        self.violations: list[str] = []
        self.digest = hashlib.sha256()
        self.transitions, self.refusals, self.stops = Counter[str](), Counter[str](), Counter[str]()
        self.arrivals: list[float] = []
        self.log = log
        self._state, self._reason, self._moving_since = "HOVERING", "", 0.0
        self._verdict: tuple[Any, ...] = ()

    def add_line(self, line: str) -> None:
        """Add a line to the log."""
        if self.log and line:
            self.lines.append(f"{self.now:.2f} s  {line}")

    def violated(self, what: str) -> None:
        """Record a violation; the same one only once."""
        if what not in self.violations:
            self.violations.append(what)
            self.add_line(f"VIOLATION: {what}")

    def requested(self, goal: tuple[float, float, float], reason: str) -> None:
        """Record a requested goal (m) and its verdict: a reason is a refusal."""
        self.digest.update(msgpack.encode((goal, reason != "")))
        if reason:
            self.refusals[_kind(reason)] += 1

    def published(self, state: SafetyState, line: str) -> None:
        """Record a state that safety published."""
        # Unless it differs from the last in stamp or wording alone, the digest covers the state.
        verdict = without_wording(replace(state, stamp=0.0))
        if verdict != self._verdict:
            self._verdict = verdict
            self.digest.update(msgpack.encode((state.stamp, verdict)))
        self.add_line(line)
        before, self._state = self._state, state.state
        if state.state != before:
            self.transitions[f"{before} -> {state.state}"] += 1
        if state.state == "MOVING" != before:
            self._moving_since = self.now
        elif before == "MOVING" and state.state == "HOVERING" and not state.reason:
            self.arrivals.append(self.now - self._moving_since)
        if state.state == "HOVERING" and state.reason != self._reason:
            self._stopped(state.reason)
        self._reason = state.reason

    def _stopped(self, reason: str) -> None:
        if reason.startswith(("stopped", "hold", "hovering")) or reason.endswith(": stopped"):
            self.stops[_kind(reason)] += 1


def _kind(reason: str) -> str:
    """Return a reason up to its numbers."""
    return reason.partition(":")[0].partition(" by ")[0].partition(" for ")[0]


APART = 1_000_000
"""Distance of the first seeds of neighbouring campaigns, so that flights never share one."""


def seeds(seed: int, flights: int) -> range:
    """Return the seeds of all flights."""
    return range(seed * APART, seed * APART + flights)


def document(seed: int, flown: Sequence[Flown]) -> dict[str, Any]:
    """Return the campaign's figures, m and s."""
    flown = sorted(flown, key=lambda flight: flight.seed)
    worst = max(flown, key=lambda flight: flight.worst)
    whole = hashlib.sha256("".join(flight.hash for flight in flown).encode())
    return {
        "flights": len(flown),
        "seed": seed,
        "worst_excursion": worst.worst,
        "worst": {"seed": worst.seed, "at": worst.at},
        "transitions": _sum(flight.transitions for flight in flown),
        "refusals": _sum(flight.refusals for flight in flown),
        "stops": _sum(flight.stops for flight in flown),
        "arrivals": arrivals([time for flight in flown for time in flight.arrivals]),
        "violations": [
            {"seed": each.seed, "what": each.violations} for each in flown if each.violations
        ],
        "hash": whole.hexdigest(),
    }


def arrivals(times: list[float]) -> dict[str, float]:
    """Return statistics of the times (s) of the flights that reached their goal."""
    times = sorted(times)
    parts = {"median": 0.5, "p90": 0.9, "p99": 0.99, "most": 1.0}
    found = {name: times[round(part * (len(times) - 1))] for name, part in parts.items() if times}
    return {"count": len(times), **found}


def _sum(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    total = Counter[str]()
    for each in counts:
        total.update(each)
    return dict(sorted(total.items()))


Point = tuple[float, float, float]


def inside(point: Point, size: Point) -> bool:
    """Return whether a point is in the cage, walls included; NaN is outside."""
    (x, y, z), (cx, cy, cz) = point, size
    return -cx <= x <= cx and -cy <= y <= cy and 0.0 <= z <= cz


def farthest(corners: Sequence[Sequence[float]], size: Point) -> float:
    """Return the farthest distance beyond the cage (m) of the box around some points."""
    outs = [
        max(max(low - value, value - high, 0.0) for value in values)
        for values, (low, high) in zip(zip(*corners, strict=True), _walls(size), strict=True)
    ]
    return sqrt(sum(out * out for out in outs))


def _walls(size: Point) -> tuple[tuple[float, float], ...]:
    cx, cy, cz = size
    return (-cx, cx), (-cy, cy), (0.0, cz)


class Score:
    """Worst excursion of each vehicle of a batch, m."""

    def __init__(self, count: int) -> None:
        """Start without a cage in force."""
        self.worst = np.zeros(count)
        self.at = np.zeros(count)
        """Its time, s."""
        self.allowed = np.full(count, np.inf)
        """Permitted distance of each beyond the cage, m."""
        self._size = np.zeros((3, count))

    def free(self, number: int) -> None:
        """Turn the cage of one vehicle off."""
        self.allowed[number] = np.inf

    def confine(self, number: int, size: Point, allowed: float) -> None:
        """Turn the cage of one vehicle on, and permit a distance beyond it, m."""
        self._size[:, number] = size
        self.allowed[number] = allowed

    def returning(self) -> Sequence[int]:
        """Return the vehicles that are allowed outside, and so may come nearer."""
        found: list[int] = np.flatnonzero((self.allowed > 0.0) & (self.allowed < np.inf)).tolist()
        return found

    def nearer(self, number: int, allowed: float) -> None:
        """Lower the permitted distance of a vehicle that can now stop nearer."""
        self.allowed[number] = min(self.allowed[number], allowed)

    def sample(self, motions: Floats, times: Sequence[float], loops: Any) -> None:
        """Record positions (m), (times, 6, vehicles), at some times (s); `loops` as in vehicles.py."""
        loops.score(motions, np.array(times), self._size, self.allowed, self.worst, self.at)
