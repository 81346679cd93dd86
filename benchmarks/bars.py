"""The bars a figure can be held to, and the verdict. Pure."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

Side = Literal["ours", "raw", "ros"]
SIDES: tuple[Side, ...] = ("ours", "raw", "ros")
NAMES: Mapping[Side, str] = {"ours": "ours", "raw": "raw Zenoh", "ros": "ROS 1"}

Verdict = Literal["holds", "missed", "not compared", "failed"]

Run = Mapping[Side, Sequence[float]]
"""What one run measured of each side."""


@dataclass(frozen=True)
class AtMost:
    """The median of ours is no larger."""

    limit: float

    def text(self, unit: str) -> str:
        """As `<= 65 ms`."""
        return f"<= {self.limit:g} {unit}".rstrip()

    def verdict(self, figure: "Figure") -> Verdict:
        """Whether the median keeps it."""
        return _verdict(figure.sides["ours"].median <= self.limit)


@dataclass(frozen=True)
class AtLeast:
    """The median of ours is no smaller."""

    limit: float

    def text(self, unit: str) -> str:
        """As `>= 100000 /s`."""
        return f">= {self.limit:.10g} {unit}".rstrip()

    def verdict(self, figure: "Figure") -> Verdict:
        """Whether the median keeps it."""
        return _verdict(figure.sides["ours"].median >= self.limit)


@dataclass(frozen=True)
class AtMostTimes:
    """The ratio of our median to a peer's, measured in the same run, is no larger."""

    factor: float
    peer: Side

    def text(self, _unit: str) -> str:
        """As `<= 1.2 x raw Zenoh`, or `<= ROS 1 / 13` where it is a fraction of one."""
        part = 1 / self.factor
        if part > 1 and abs(part - round(part)) < 1e-9:
            return f"<= {NAMES[self.peer]} / {round(part)}"
        return f"<= {self.factor:g} x {NAMES[self.peer]}"

    def verdict(self, figure: "Figure") -> Verdict:
        """Whether the median of the runs' ratios keeps it; not compared without the peer."""
        ratio = figure.ratio(self.peer)
        return "not compared" if ratio is None else _verdict(ratio <= self.factor)


Bar = AtMost | AtLeast | AtMostTimes


@dataclass(frozen=True)
class Summary:
    """One side's median and its bad tail: the 99th percentile, or the 1st where more is better."""

    median: float
    tail: float
    n: int


@dataclass(frozen=True)
class Figure:
    """What was measured of one row.

    `ratios` has, for each peer, ours divided by the peer's median, run by run. `missing` says
    why a side has no values; `error` why the row could not be measured.
    """

    sides: Mapping[Side, Summary]
    ratios: Mapping[Side, Sequence[float]]
    missing: Mapping[Side, str]
    error: str = ""

    def ratio(self, peer: Side) -> float | None:
        """The median of the runs' ratios to a peer, None without the peer."""
        ratios = self.ratios.get(peer)
        return statistics.median(ratios) if ratios else None


def judge(figure: Figure, bars: Sequence[Bar]) -> Verdict:
    """The verdict of a row: the worst of its bars'; a missing peer leaves the others in force."""
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
    """The figure of a row's runs."""
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
    """The value below which that part of the values lies, by the nearest rank."""
    ordered = sorted(values)
    return ordered[round(part * (len(ordered) - 1))]


def _ratio(run: Run, peer: Side) -> list[float]:
    ours, theirs = run.get("ours"), run.get(peer)
    if not ours or not theirs or not (median := statistics.median(theirs)):
        return []
    return [statistics.median(ours) / median]


def _verdict(holds: bool) -> Verdict:
    return "holds" if holds else "missed"
