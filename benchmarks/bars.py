"""Limits of a figure (bars), and the verdict on them. Pure."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

Side = Literal["ours", "raw", "ros"]
SIDES: tuple[Side, ...] = ("ours", "raw", "ros")
NAMES: Mapping[Side, str] = {"ours": "ours", "raw": "raw Zenoh", "ros": "ROS 1"}

Verdict = Literal["holds", "missed", "not compared", "failed"]

Run = Mapping[Side, Sequence[float]]
"""Values that one run measured, by side."""


@dataclass(frozen=True)
class AtMost:
    """Bar that our median must not exceed."""

    limit: float

    def text(self, unit: str) -> str:
        """Return the bar as text, e.g. `<= 65 ms`."""
        return f"<= {self.limit:g} {unit}".rstrip()

    def verdict(self, figure: "Figure") -> Verdict:
        """Return whether our median keeps the bar."""
        return _verdict(figure.sides["ours"].median <= self.limit)


@dataclass(frozen=True)
class AtLeast:
    """Bar that our median must reach."""

    limit: float

    def text(self, unit: str) -> str:
        """Return the bar as text, e.g. `>= 100000 /s`."""
        return f">= {self.limit:.10g} {unit}".rstrip()

    def verdict(self, figure: "Figure") -> Verdict:
        """Return whether our median keeps the bar."""
        return _verdict(figure.sides["ours"].median >= self.limit)


@dataclass(frozen=True)
class AtMostTimes:
    """Bar that the ratio of our median to a peer's, measured in the same run, must not exceed."""

    factor: float
    peer: Side

    def text(self, _unit: str) -> str:
        """Return the bar as text, e.g. `<= 1.2 x raw Zenoh`, or `<= ROS 1 / 13` for a factor under 1."""
        part = 1 / self.factor
        if part > 1 and abs(part - round(part)) < 1e-9:
            return f"<= {NAMES[self.peer]} / {round(part)}"
        return f"<= {self.factor:g} x {NAMES[self.peer]}"

    def verdict(self, figure: "Figure") -> Verdict:
        """Return whether the median of the runs' ratios keeps the bar; not compared without the peer."""
        ratio = figure.ratio(self.peer)
        return "not compared" if ratio is None else _verdict(ratio <= self.factor)


@dataclass(frozen=True)
class AtLeastTimes:
    """Bar that the ratio of our median to a peer's, measured in the same run, must reach."""

    factor: float
    peer: Side

    def text(self, _unit: str) -> str:
        """Return the bar as text, e.g. `>= 0.8 x raw Zenoh`."""
        return f">= {self.factor:g} x {NAMES[self.peer]}"

    def verdict(self, figure: "Figure") -> Verdict:
        """Return whether the median of the runs' ratios keeps the bar; not compared without the peer."""
        ratio = figure.ratio(self.peer)
        return "not compared" if ratio is None else _verdict(ratio >= self.factor)


Bar = AtMost | AtLeast | AtMostTimes | AtLeastTimes


@dataclass(frozen=True)
class KnownMiss:
    """Reason why a row misses `bar`, printed below the table; `until` must hold meanwhile."""

    bar: Bar
    until: Bar
    why: str

    def excuses(self, figure: "Figure", bars: "Sequence[Bar]") -> bool:
        """Return whether the row misses no other bar, and this one by no more than is known."""
        now = [self.until if bar == self.bar else bar for bar in bars]
        return judge(figure, now) in {"holds", "not compared"}


@dataclass(frozen=True)
class Summary:
    """Median of one side and its bad tail: the 99th percentile, or the 1st where more is better."""

    median: float
    tail: float
    n: int


@dataclass(frozen=True)
class Figure:
    """Measurements of one row.

    `ratios` has our median divided by each peer's, run by run. `missing` has the reason for a
    side without values, `error` the reason for a row without measurements.
    """

    sides: Mapping[Side, Summary]
    ratios: Mapping[Side, Sequence[float]]
    missing: Mapping[Side, str]
    error: str = ""

    def ratio(self, peer: Side) -> float | None:
        """Return the median of the runs' ratios to a peer, None without the peer."""
        ratios = self.ratios.get(peer)
        return statistics.median(ratios) if ratios else None


def judge(figure: Figure, bars: Sequence[Bar]) -> Verdict:
    """Return the worst verdict of the bars; without a peer, the bars of the others still count."""
    if figure.error or "ours" not in figure.sides:
        return "failed"
    verdicts = [bar.verdict(figure) for bar in bars]
    for worst in ("missed", "not compared"):
        if worst in verdicts:
            return worst
    return "holds"


def summarise(
    runs: Sequence[Run], missing: Mapping[Side, str], error: str, *, more_is_better: bool
) -> Figure:
    """Return the figure that a row's runs give."""
    sides, ratios = {}, {}
    for side in SIDES:
        pooled = [value for run in runs for value in run.get(side, ())]
        if pooled:
            tail = percentile(pooled, 0.01 if more_is_better else 0.99)
            sides[side] = Summary(statistics.median(pooled), tail, len(pooled))
        if side != "ours":
            ratios[side] = [ratio for run in runs for ratio in _ratio(run, side)]
    return Figure(sides, {side: found for side, found in ratios.items() if found}, missing, error)


def percentile(values: Sequence[float], part: float) -> float:
    """Return the value below which that part of the values lies, by the nearest rank."""
    ordered = sorted(values)
    return ordered[round(part * (len(ordered) - 1))]


def _ratio(run: Run, peer: Side) -> list[float]:
    ours, theirs = run.get("ours"), run.get(peer)
    if not ours or not theirs or not (median := statistics.median(theirs)):
        return []
    return [statistics.median(ours) / median]


def _verdict(holds: bool) -> Verdict:
    return "holds" if holds else "missed"
