"""One measured figure and the bar it is held to."""

import statistics
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Figure:
    """What was measured, in which unit, and the most it may be."""

    name: str
    unit: str
    bar: float
    median: float
    p99: float
    n: int

    @property
    def holds(self) -> bool:
        """Whether the median keeps the bar."""
        return self.median <= self.bar

    def line(self) -> str:
        """For a person."""
        verdict = "holds" if self.holds else "MISSED"
        return (
            f"{self.name:52} {self.median:9.4g} {self.unit:4} (p99 {self.p99:.4g}, n {self.n}),"
            f" bar {self.bar:g}: {verdict}"
        )

    def plain(self) -> dict[str, object]:
        """For JSON."""
        return asdict(self) | {"holds": self.holds}


def figure(name: str, unit: str, bar: float, values: list[float]) -> Figure:
    """The figure of a sample."""
    ordered = sorted(values)
    p99 = ordered[min(len(ordered) - 1, round(0.99 * (len(ordered) - 1)))]
    return Figure(name, unit, bar, statistics.median(ordered), p99, len(ordered))
