"""What the kernel says of processes: memory in MB, processor time in seconds."""

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

_TICK = os.sysconf("SC_CLK_TCK")


def pss(pid: int) -> float:
    """Proportional set size, MB: its own pages, and its share of those it shares."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8")
    found = re.search(r"^Pss:\s+(\d+) kB$", text, re.MULTILINE)
    assert found is not None
    return int(found[1]) / 1024


def busy(pid: int) -> float:
    """Processor time that a process has used, user and system, s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    # utime and stime are the 14th and 15th field; state, the third, comes first here.
    return (int(fields[11]) + int(fields[12])) / _TICK


def busy_of(pids: Iterable[int]) -> Mapping[int, float]:
    """The same of several."""
    return {pid: busy(pid) for pid in pids}
