"""Log, excursion and report of simulated flights.

The digest covers no wording, neither of reasons nor of log lines.

The excursion is the distance of the true position beyond the cage in force. A vehicle that was
inside when the cage came on or changed must not go beyond it. A vehicle that was outside then, or
could no longer stop inside, may go as far as its stopping point at that instant, and never out
again once it has come nearer.
"""

import hashlib
from bisect import bisect
from collections import Counter
from collections.abc import Sequence
from itertools import accumulate
from math import inf, sqrt
from typing import Any, Self

import numpy as np
from msgspec import Struct, msgpack
from msgspec.structs import replace

from quadctl.schemas.messages import SafetyState, without_wording
from quadctl.schemas.params import SafetyParams
from quadctl.schemas.topics import SETPOINT
from quadctl.services.airspace.geometry import Point
from quadctl.services.campaign.watch import Floats


class LaunchCage(Struct, frozen=True):
    """Cage at the launch: whether it is on, and its bounds, m."""

    on: bool
    x: float
    y: float
    z: float

    @classmethod
    def of(cls, safety: SafetyParams) -> Self:
        """Return the cage in safety's parameters."""
        size = safety.virtual_cage
        return cls(safety.cage_on, size.x, size.y, size.z)


class Flown(Struct, frozen=True):
    """Figures of one flight.

    Worst excursion (m) and its time (s); how often each transition, refusal, stop, rule of the
    automaton (`guards`) and fault occurred; mean wind (m/s, east and north), arrival times (s). With
    several vehicles, the least distance between two (m), and its time (s).
    """

    seed: int
    cage: LaunchCage
    worst_excursion: float
    at: float
    transitions: dict[str, int]
    refusals: dict[str, int]
    stops: dict[str, int]
    guards: dict[str, int]
    wind: tuple[float, float]
    faults: dict[str, int]
    arrivals: list[float]
    violations: list[str]
    hash: str
    separation: tuple[float, float] | None = None


class FlightLog:
    """Record of a flight in progress; the writer sets `now` (s)."""

    def __init__(self, *, log: bool) -> None:
        """Start empty; keep lines only with `log`."""
        self.now = 0.0
        self.lines: list[str] = []
        self.violations: list[str] = []
        self.digest = hashlib.sha256()
        self.transitions, self.refusals, self.stops = Counter[str](), Counter[str](), Counter[str]()
        self.fired: list[object] = []
        """Rules of the automaton, in their order; their text is their name."""
        self.arrivals: list[float] = []
        self.log = log
        self.changed_at = 0.0
        """Time (s) of the last state that was published."""
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
        self.changed_at = self.now
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


class Tally:
    """Figures of a campaign, which grow with each flight; its memory does not."""

    def __init__(self, seeds: range) -> None:
        """Start without a flight of these seeds."""
        self.flights = 0
        self.worst: Flown | None = None
        self._next, self._early = seeds.start, dict[int, str]()
        self._digest = hashlib.sha256()
        self._counts = {name: Counter[str]() for name in ("transitions", "refusals", "stops")}
        self._arrivals = Counter[int]()
        self._violations: list[dict[str, Any]] = []
        self._nearest: Flown | None = None

    def add(self, flight: Flown) -> None:
        """Add a flight; the digest takes those that come early in the order of their seeds."""
        self.flights += 1
        if self.worst is None or _rank(flight) > _rank(self.worst):
            self.worst = flight
        for name, counts in self._counts.items():
            counts.update(getattr(flight, name))
        self._arrivals.update(round(seconds * SETPOINT.hz) for seconds in flight.arrivals)
        if flight.violations:
            self._violations.append({"seed": flight.seed, "what": flight.violations})
        if flight.separation and (self._nearest is None or _near(flight) < _near(self._nearest)):
            self._nearest = flight
        self._early[flight.seed] = flight.hash
        while (found := self._early.pop(self._next, None)) is not None:
            self._digest.update(found.encode())
            self._next += 1

    def document(self, seed: int) -> dict[str, Any]:
        """Return the figures of all flights of a campaign's seed, m and s."""
        worst = self.worst
        assert worst is not None  # noqa: S101 - a campaign has at least one flight
        near = self._nearest
        return {
            "flights": self.flights,
            "seed": seed,
            "worst_excursion": worst.worst_excursion,
            "worst": {"seed": worst.seed, "at": worst.at},
            **{name: dict(sorted(counts.items())) for name, counts in self._counts.items()},
            "arrivals": arrivals(self._arrivals),
            "violations": sorted(self._violations, key=lambda each: each["seed"]),
            **({"separation": _separation(near)} if near else {}),
            "hash": self._digest.hexdigest(),
        }


def _rank(flight: Flown) -> tuple[float, int]:
    """Return the place of a flight among the worst; of two equal ones the first seed is worse."""
    return flight.worst_excursion, -flight.seed


def _near(flight: Flown) -> tuple[float, int]:
    return (flight.separation or (inf,))[0], flight.seed


def _separation(flight: Flown) -> dict[str, float]:
    worst, at = flight.separation or (inf, 0.0)
    return {"worst": worst, "seed": flight.seed, "at": at}


def arrivals(periods: Counter[int]) -> dict[str, float]:
    """Return statistics (s) of the times, in periods of the setpoint, to reach a goal."""
    count = periods.total()
    parts = {"median": 0.5, "p90": 0.9, "p99": 0.99, "most": 1.0}
    ordered = sorted(periods)
    ends = list(accumulate(periods[each] for each in ordered))
    places = {
        name: bisect(ends, round(part * (count - 1))) for name, part in parts.items() if count
    }
    return {"count": count, **{name: ordered[n] / SETPOINT.hz for name, n in places.items()}}


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
    """Worst excursion of each vehicle of a batch, m, and least distance in each flight."""

    def __init__(self, count: int, vehicles: int = 1) -> None:
        """Start without a cage in force; each flight has as many vehicles."""
        self._vehicles = vehicles
        self.separation = np.full(count // vehicles, np.inf)
        """Least distance between two vehicles of a flight, m."""
        self.separation_at = np.zeros(count // vehicles)
        """Its time, s."""
        self.worst = np.zeros(count)
        self.at = np.zeros(count)
        """Its time, s."""
        self.nearest: Floats | None = None
        """If wanted, the distance from the nearest wall or the top, m: negative inside."""
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
        moments = np.array(times)
        loops.score(motions, moments, self._size, self.allowed, self.worst, self.at)
        if self.nearest is not None:
            loops.approach(motions, self._size, self.allowed, self.nearest)
        if self._vehicles > 1:
            loops.separate(motions, moments, self._vehicles, self.separation, self.separation_at)
