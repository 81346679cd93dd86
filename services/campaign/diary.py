"""What is kept of a flight: counts, times, violations, and a digest of its states and verdicts.

The digest covers no wording: neither a reason's nor a log line's.
"""

import hashlib
from collections import Counter
from typing import Any

from msgspec import Struct, msgpack
from msgspec.structs import replace

from schemas.messages import SafetyState, without_wording


class Flown(Struct, frozen=True):
    """One flight's figures: the worst excursion (m) and when (s), counts, arrival times (s)."""

    seed: int
    worst: float
    at: float
    transitions: dict[str, int]
    refusals: dict[str, int]
    stops: dict[str, int]
    arrivals: list[float]
    violations: list[str]
    hash: str


class Diary:
    """Written while a flight goes on; `now` (s) is set by who writes."""

    def __init__(self, *, log: bool) -> None:
        """With `log` the lines are kept as well."""
        self.now = 0.0
        self.lines: list[str] = []
        self.violations: list[str] = []
        self.digest = hashlib.sha256()
        self.transitions, self.refusals, self.stops = Counter[str](), Counter[str](), Counter[str]()
        self.arrivals: list[float] = []
        self.log = log
        self._state, self._reason, self._taken = "HOVERING", "", 0.0
        self._verdict: tuple[Any, ...] = ()

    def say(self, line: str) -> None:
        """A line for who reads the flight."""
        if self.log and line:
            self.lines.append(f"{self.now:.2f} s  {line}")

    def violated(self, what: str) -> None:
        """Something happened that must not; the same thing is told once."""
        if what not in self.violations:
            self.violations.append(what)
            self.say(f"VIOLATION: {what}")

    def asked(self, goal: tuple[float, float, float], reason: str) -> None:
        """Keep a goal that was asked for (m) and its verdict: a reason is a refusal."""
        self.digest.update(msgpack.encode((goal, reason != "")))
        if reason:
            self.refusals[_kind(reason)] += 1

    def told(self, state: SafetyState, line: str) -> None:
        """Safety published a state."""
        self._hash(state)
        self.say(line)
        before, self._state = self._state, state.state
        if state.state != before:
            self.transitions[f"{before} -> {state.state}"] += 1
        if state.state == "MOVING" != before:
            self._taken = self.now
        elif before == "MOVING" and state.state == "HOVERING" and not state.reason:
            self.arrivals.append(self.now - self._taken)
        if state.state == "HOVERING" and state.reason != self._reason:
            self._stopped(state.reason)
        self._reason = state.reason

    def _hash(self, state: SafetyState) -> None:
        """Add a state to the digest, unless it differs from the last in stamp or wording alone."""
        verdict = without_wording(replace(state, stamp=0.0))
        if verdict != self._verdict:
            self._verdict = verdict
            self.digest.update(msgpack.encode((state.stamp, verdict)))

    def _stopped(self, reason: str) -> None:
        if reason.startswith(("stopped", "hold", "hovering")) or reason.endswith(": stopped"):
            self.stops[_kind(reason)] += 1


def _kind(reason: str) -> str:
    """What a reason says before it comes to numbers."""
    return reason.partition(":")[0].partition(" by ")[0].partition(" for ")[0]
