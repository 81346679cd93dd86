"""What processes take of the machine, where /proc tells it."""

import os
from pathlib import Path

_PROC = Path("/proc")
_MEGABYTE = 1e6


def memory(pid: int) -> float | None:
    """The memory (MB) that a process has in use now, None where that is not told."""
    try:
        pages = int((_PROC / str(pid) / "statm").read_bytes().split()[1])
    except (OSError, IndexError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / _MEGABYTE


def processor_time(pid: int) -> float | None:
    """The processor time (s) that a process has taken so far, None where that is not told."""
    try:
        # After the program's name, which may hold blanks and brackets itself.
        fields = (_PROC / str(pid) / "stat").read_bytes().rpartition(b")")[2].split()
        user, system = int(fields[11]), int(fields[12])
    except (OSError, IndexError):
        return None
    return (user + system) / os.sysconf("SC_CLK_TCK")


class Shares:
    """How much of a core processes take, from one look to the next."""

    def __init__(self) -> None:
        self._last: dict[int, tuple[float, float]] = {}

    def look(self, pids: list[int], now: float) -> dict[int, float]:
        """Per cent of a core by pid, since the last look at it; `now` is a clock's time (s)."""
        taken = {pid: time for pid in pids if (time := processor_time(pid)) is not None}
        shares = {
            pid: 100 * (time - self._last[pid][0]) / (now - self._last[pid][1])
            for pid, time in taken.items()
            if pid in self._last and now > self._last[pid][1]
        }
        self._last = {pid: (time, now) for pid, time in taken.items()}
        return shares
