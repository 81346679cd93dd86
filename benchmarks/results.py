"""What the parts measured, row by row, until it is summed up."""

from collections import defaultdict
from collections.abc import Iterable

from benchmarks.bars import Figure, Side, summarise
from benchmarks.rows import BY_KEY


class Results:
    """Collects values, and why there are none."""

    def __init__(self) -> None:
        self.notes: dict[str, dict[str, float]] = {}
        """Breakdowns beside the rows, as each process's share of the processor."""
        self._runs: dict[str, dict[int, dict[Side, list[float]]]] = defaultdict(dict)
        self._missing: dict[str, dict[Side, str]] = defaultdict(dict)
        self._errors: dict[str, str] = {}

    def add(self, key: str, side: Side, values: Iterable[float], run: int = 0) -> None:
        """Values of a row, in its own unit."""
        self._runs[key].setdefault(run, {}).setdefault(side, []).extend(values)

    def seconds(self, key: str, side: Side, values: Iterable[float], run: int = 0) -> None:
        """Times in seconds, of a row whose unit is one of time."""
        factor = BY_KEY[key].per_second
        self.add(key, side, (value * factor for value in values), run)

    def missing(self, keys: Iterable[str], side: Side, why: str) -> None:
        """A peer is not on this machine."""
        for key in keys:
            self._missing[key][side] = why

    def fail(self, keys: Iterable[str], error: str) -> None:
        """Rows that could not be measured; the first reason stays."""
        for key in keys:
            self._errors.setdefault(key, error)

    def failed(self, key: str) -> bool:
        """Whether the row is given up."""
        return key in self._errors

    def figure(self, key: str) -> Figure:
        """The figure of a row."""
        runs = list(self._runs[key].values())
        error = self._errors.get(key, "" if runs else "nothing was measured")
        row = BY_KEY[key]
        return summarise(runs, self._missing[key], error, more_is_better=row.more_is_better)
