"""The share of a core that each process takes."""

from collections.abc import Mapping


class Shares:
    """Shares of a core, from the CPU times of two looks."""

    def __init__(self) -> None:
        self._last: dict[int, tuple[float, float]] = {}

    def look(self, taken: Mapping[int, float], now: float) -> dict[int, float]:
        """Return per cent of a core by pid, since the previous look at the process.

        `taken` has the CPU time (s) by pid, `now` is a clock's time (s).
        """
        shares = {
            pid: 100 * (cpu - self._last[pid][0]) / (now - self._last[pid][1])
            for pid, cpu in taken.items()
            if pid in self._last and now > self._last[pid][1]
        }
        self._last = {pid: (cpu, now) for pid, cpu in taken.items()}
        return shares
