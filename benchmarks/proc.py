"""Memory (MB) and processor time (s) of processes, from the kernel."""

from collections.abc import Iterable, Mapping

from quadctl.services.runtime import procfs


def pss(pid: int) -> float:
    """Return the proportional set size (MB): private pages, and a share of shared ones."""
    found = procfs.pss_of(pid)
    assert found is not None, f"process {pid} has ended"
    return found / 1024 / 1024


def busy(pid: int) -> float:
    """Return the processor time of a process (s), user and system."""
    found = procfs.stats_of(pid).cpu
    assert found is not None, f"process {pid} has ended"
    return found


def busy_of(pids: Iterable[int]) -> Mapping[int, float]:
    """Return the processor time (s) of several processes by pid."""
    return {pid: busy(pid) for pid in pids}
