"""Values that the parts measure, row by row, until they are summarised."""

from collections import defaultdict
from collections.abc import Iterable

from benchmarks.bars import Figure, Side, summarise
from benchmarks.rows import BY_KEY


class Results:
    """Values by row, and reasons for missing ones."""

    def __init__(self) -> None:
        self.notes: dict[str, dict[str, float]] = {}
        """Breakdowns beside the rows, e.g. each process's share of the processor."""
        self._runs: dict[str, dict[int, dict[Side, list[float]]]] = defaultdict(dict)
        self._missing: dict[str, dict[Side, str]] = defaultdict(dict)
        self._errors: dict[str, str] = {}

    def add(self, key: str, side: Side, values: Iterable[float], run: int = 0) -> None:
        """Add values of a row, in the unit of that row."""
        self._runs[key].setdefault(run, {}).setdefault(side, []).extend(values)

    def seconds(self, key: str, side: Side, values: Iterable[float], run: int = 0) -> None:
        """Add times (s) of a row whose unit is a time."""
        factor = BY_KEY[key].per_second
        self.add(key, side, (value * factor for value in values), run)

    def missing(self, keys: Iterable[str], side: Side, why: str) -> None:
        """Record that a peer is not on this machine."""
        for key in keys:
            self._missing[key][side] = why

    def fail(self, keys: Iterable[str], error: str) -> None:
        """Record rows that could not be measured; the first reason is kept."""
        for key in keys:
            self._errors.setdefault(key, error)

    def failed(self, key: str) -> bool:
        """Return whether the row could not be measured."""
        return key in self._errors

    def figure(self, key: str) -> Figure:
        """Return the figure of a row."""
        runs = list(self._runs[key].values())
        error = self._errors.get(key, "" if runs else "nothing was measured")
        row = BY_KEY[key]
        return summarise(runs, self._missing[key], error, more_is_better=row.more_is_better)
