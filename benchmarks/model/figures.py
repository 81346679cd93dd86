"""Figures of one run: simulators, bars, and the two tables of docs/figures.md. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.bars import Verdict
from benchmarks.model.peers.timing import COUNTS
from benchmarks.report import number


@dataclass(frozen=True)
class Runner:
    """Simulator with its number format and integrator (`numbers`) and its environment (`peer`)."""

    key: str
    name: str
    numbers: str
    peer: str = ""


RUNNERS = (
    Runner("plain", "quadctl, plain Python", "double, RK4"),
    Runner("compiled", "quadctl, numba", "double, RK4"),
    Runner("strict", "the same by hand in C++, equal bits", "double, RK4"),
    Runner("fast", "the same with g++ -Ofast, other bits", "double, RK4"),
    Runner("rotorpy", "rotorpy, without air", "double, RK45, rtol 1e-2", "rotorpy"),
    Runner("rotorpybatch", "rotorpy, torch", "double, RK4", "rotorpy"),
    Runner("mujoco", "mujoco", "double, RK4", "mujoco"),
    Runner("crazyflow", "crazyflow, JAX", "single, RK4", "crazyflow"),
)

Rates = Mapping[str, Mapping[str, Mapping[str, float]]]
"""Vehicle-steps per second by runner, mode and number of vehicles (as text)."""


Paired = Mapping[str, float]
"""Ratios measured separately, in alternating slices (paired.py), by the key of their bar."""


@dataclass(frozen=True)
class Bar:
    """Least ratio of our speed to a peer's, for steps without a controller, in one run."""

    ours: str
    count: int
    factor: float
    peer: str
    peers_count: int

    @property
    def key(self) -> str:
        """Return the key, e.g. `compiled:strict`."""
        return f"{self.ours}:{self.peer}"

    def ratio(self, rates: Rates, paired: Paired) -> float | None:
        """Return our speed divided by the peer's; None if the peer was not measured."""
        if self.key in paired:
            return paired[self.key]
        theirs = rates.get(self.peer, {}).get("dynamics", {}).get(str(self.peers_count))
        ours = rates.get(self.ours, {}).get("dynamics", {}).get(str(self.count))
        return ours / theirs if ours and theirs else None

    def verdict(self, rates: Rates, paired: Paired) -> Verdict:
        """Return whether the ratio reaches the bar."""
        ratio = self.ratio(rates, paired)
        if ratio is None:
            return "not compared"
        return "holds" if ratio >= self.factor else "missed"


PAIRED = Bar("compiled", 10_000, 0.9, "strict", 10_000)
"""Bar too near to 1 for two separate measurements."""
BARS = (
    Bar("plain", 1, 40, "rotorpy", 1),
    Bar("compiled", 10_000, 1000, "rotorpybatch", 10_000),
    PAIRED,
    Bar("compiled", 10_000, 20, "crazyflow", 10_000),
)


def tables(document: Mapping[str, Any]) -> str:
    """Return the tables of speeds and of bars with their verdicts."""
    heads = ["vehicle-steps per second of one core", "", *(f"{count:,}" for count in COUNTS)]
    heads += ["with controller", "whole flight", "of peak", "import", "memory"]
    lines = [f"| {' | '.join(heads)} |", "|---|---|" + "---:|" * (len(heads) - 2)]
    lines += [_line(runner, document) for runner in RUNNERS]
    lines += ["", "| steps alone | ratio | bar | |", "|---|---|---|---|"]
    names = {runner.key: runner.name for runner in RUNNERS}
    rates: Rates = document["rates"]
    paired: Paired = document["paired"]
    for bar in BARS:
        ratio = bar.ratio(rates, paired)
        ours = f"{names[bar.ours]} at {bar.count:,} : {names[bar.peer]} at {bar.peers_count:,}"
        shown = "-" if ratio is None else number(ratio)
        verdict = bar.verdict(rates, paired)
        bold = f"**{verdict}**" if verdict == "missed" else verdict
        lines.append(f"| {ours} | {shown} | >= {bar.factor:g} | {bold} |")
    machine = document["machine"]
    measured = (
        f"A step is 1 ms. Measured by `python -m benchmarks.model --write` on {machine['processor']},"
        f" Python {machine['python']}, {machine['date']}, commit {machine['commit']}, load"
        f" {machine['load']}; the peers' versions:"
        f" {', '.join(f'{key} {said}' for key, said in document['versions'].items())}."
    )
    lines += ["", measured]
    return "\n".join(lines) + "\n"


def _line(runner: Runner, document: Mapping[str, Any]) -> str:
    key = runner.key
    if key in document["missing"]:
        return f"| {runner.name} | {document['missing'][key]} |" + " |" * (len(COUNTS) + 5)
    rates = document["rates"][key]
    alone = rates["dynamics"]
    most = max(alone.values())
    part = most * document["flops"] / (document["peak"] * 1e9) if _same_model(key) else None
    cells = [_speed(alone.get(str(count))) for count in COUNTS]
    cells += [_speed(_most(rates.get(mode))) for mode in ("control", "flight")]
    cells.append("" if part is None else f"{100 * part:.2g} %")
    imported = document["imports"][key]
    cells.append(f"{number(imported)} s" if imported else "")
    cells.append(f"{number(document['memory'][key])} MB")
    return f"| {runner.name} | {runner.numbers} | {' | '.join(cells)} |"


def _same_model(key: str) -> bool:
    """Return whether a runner's step has the operations that were counted."""
    return key in {"plain", "compiled", "strict", "fast"}


def _most(rates: Mapping[str, float] | None) -> float | None:
    return max(rates.values()) if rates else None


def _speed(value: float | None) -> str:
    if value is None:
        return ""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{number(value / size)} {letter}"
    return number(value)
