"""What the operating system tells of a process, where it has /proc; elsewhere nothing."""

import os
import time
from pathlib import Path

from msgspec import Struct

_PROC = Path("/proc/self")
_PPID, _UTIME, _STIME, _STARTED = 1, 11, 12, 19
"""Fields of /proc/PID/stat, counted behind the command's name."""


class Vitals(Struct, frozen=True):
    """Memory in bytes, CPU time and uptime in seconds; None where it is not told.

    `pss` counts a page that several processes share in equal parts, `rss` in full for each.
    """

    rss: int | None = None
    pss: int | None = None
    cpu: float | None = None
    uptime: float | None = None


def vitals_of(pid: int) -> Vitals:
    """What is told of a process; nothing of one that has ended."""
    stat = _stat(pid)
    if not stat:
        return Vitals()
    second = os.sysconf("SC_CLK_TCK")
    memory = _memory(pid)
    return Vitals(
        rss=memory.get("Rss"),
        pss=memory.get("Pss"),
        cpu=(int(stat[_UTIME]) + int(stat[_STIME])) / second,
        uptime=time.clock_gettime(time.CLOCK_BOOTTIME) - int(stat[_STARTED]) / second,
    )


def parent_of(pid: int) -> int | None:
    """The process that has started it, None where that is not told."""
    stat = _stat(pid)
    return int(stat[_PPID]) if stat else None


def has_ended(pid: int) -> bool:
    """Whether a process has ended, waited for or not; False where that is not told."""
    stat = _stat(pid)
    return stat[0] in "ZX" if stat else _PROC.is_dir()


def is_frozen(pid: int) -> bool:
    """Whether a process is stopped by a signal; False where that is not told."""
    stat = _stat(pid)
    return bool(stat) and stat[0] in "Tt"


def _stat(pid: int) -> list[str]:
    text = _read(pid, "stat")
    # The name, in brackets, may hold blanks and brackets itself.
    return text.rpartition(")")[2].split()


def _memory(pid: int) -> dict[str, int]:
    """Bytes by name; empty for another user's process."""
    rows = [line.split() for line in _read(pid, "smaps_rollup").splitlines()]
    return {row[0].rstrip(":"): int(row[1]) * 1024 for row in rows if row[-1:] == ["kB"]}


def _read(pid: int, name: str) -> str:
    try:
        return Path(f"/proc/{pid}/{name}").read_text(encoding="utf-8", errors="replace")
    except OSError:
        # There is no /proc here, the process has ended, or it is another user's.
        return ""
