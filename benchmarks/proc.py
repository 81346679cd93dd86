"""What the kernel says of processes: memory in MB, processor time in seconds."""

from collections.abc import Iterable, Mapping

from quadctl.services.runtime import procfs


def pss(pid: int) -> float:
    """Proportional set size, MB: its own pages, and its share of those it shares."""
    found = procfs.pss_of(pid)
    assert found is not None, f"process {pid} has ended"
    return found / 1024 / 1024


def busy(pid: int) -> float:
    """Processor time that a process has used, user and system, s."""
    found = procfs.stats_of(pid).cpu
    assert found is not None, f"process {pid} has ended"
    return found


def busy_of(pids: Iterable[int]) -> Mapping[int, float]:
    """The same of several."""
    return {pid: busy(pid) for pid in pids}
