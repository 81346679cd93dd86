"""Figures of a process from Linux's /proc; None on other systems."""

import os
import time

from msgspec import Struct

_PROC = "/proc"
_PPID, _UTIME, _STIME, _STARTED = 1, 11, 12, 19
"""Fields of /proc/PID/stat, counted after the command's name."""
_RESIDENT = 1
"""Field of /proc/PID/statm: pages in memory."""
_WAITED = 1
"""Field of /proc/PID/schedstat: nanoseconds in which it could run, but had no processor."""


class ProcessStats(Struct, frozen=True):
    """State, resident memory in bytes, CPU time and uptime in seconds; None where unknown.

    `state` is the letter of /proc/PID/stat, empty for a process that is gone. `rss` counts a page
    that several processes share in full for each of them, `pss_of` in equal parts.
    """

    state: str | None = None
    rss: int | None = None
    cpu: float | None = None
    uptime: float | None = None


def stats_of(pid: int) -> ProcessStats:
    """Read the figures of a process."""
    stat = _stat(pid)
    if not stat:
        return ProcessStats("" if _is_mounted() else None)
    second = os.sysconf("SC_CLK_TCK")
    memory = _read(pid, "statm").split()
    pages = int(memory[_RESIDENT]) if memory else 0  # 0 of a process that has ended
    return ProcessStats(
        state=stat[0],
        rss=pages * os.sysconf("SC_PAGE_SIZE") or None,
        cpu=(int(stat[_UTIME]) + int(stat[_STIME])) / second,
        uptime=time.clock_gettime(time.CLOCK_BOOTTIME) - int(stat[_STARTED]) / second,
    )


def pss_of(pid: int) -> int | None:
    """Read the proportional memory of a process, bytes; None where unknown, e.g. another user's.

    The kernel walks all pages of the process: slower than `stats_of`.
    """
    for line in _read(pid, "smaps_rollup").splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * 1024
    return None


class WaitMeter:
    """Meter of the time for which the main thread of a process, or of a descendant, waits for a processor."""

    def __init__(self) -> None:
        self._waits: dict[int, float] = {}

    def read(self, pid: int) -> float:
        """Return the seconds since the last call, of the process that waited longest; 0 where unknown."""
        before, self._waits = self._waits, _waits_of(pid)
        return max([0.0, *(wait - before.get(one, 0.0) for one, wait in self._waits.items())])


def _waits_of(pid: int) -> dict[int, float]:
    fields = _read(pid, "schedstat").split()
    waits = {pid: int(fields[_WAITED]) / 1e9} if fields else {}
    for child in _read(pid, f"task/{pid}/children").split():
        waits |= _waits_of(int(child))
    return waits


def parent_of(pid: int) -> int | None:
    """Return the process that started this one, None where unknown."""
    stat = _stat(pid)
    return int(stat[_PPID]) if stat else None


def has_ended(pid: int) -> bool:
    """Return whether a process has ended, waited for or not; False where unknown."""
    stat = _stat(pid)
    return stat[0] in "ZX" if stat else _is_mounted()


def is_frozen(pid: int) -> bool:
    """Return whether a process is stopped by a signal; False where unknown."""
    stat = _stat(pid)
    return bool(stat) and stat[0] in "Tt"


def _is_mounted() -> bool:
    return os.path.isdir(f"{_PROC}/self")


def _stat(pid: int) -> list[str]:
    # The name, in brackets, may itself contain blanks and brackets.
    return _read(pid, "stat").rpartition(")")[2].split()


def _read(pid: int, name: str) -> str:
    try:
        with open(f"{_PROC}/{pid}/{name}", encoding="utf-8", errors="replace") as file:
            return file.read()
    except OSError:
        # No /proc on this system, a process that has ended, or another user's.
        return ""
