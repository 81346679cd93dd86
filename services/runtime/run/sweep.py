"""Finding what a user's command has started, wherever it has gone to.

A command is started with a mark in its environment, which all that it starts inherits, in
whatever session and under whatever parent. What has cleared its environment and also left its
command's process group (`env -i setsid ..`), has written over it, or runs as another user, is not
found; where there is no /proc, only the process group is reached.
"""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

MARK = "QUADCTL_LEASH"
_PROC = Path("/proc")
_MOST_SWEEPS = 20


def new_leash() -> str:
    """A mark that no other run has; a command's own adds its name."""
    return f"{os.getpid()}.{time.time_ns()}/"


def sweep(leash: str, number: int) -> int:
    """Send a signal to every other process whose mark begins with the leash; how many."""
    if sys.platform != "linux":
        return 0
    count = 0
    for pid in _pids():
        # The descriptor stays with this very process, should its id be given to another.
        with contextlib.suppress(OSError), _opened(pid) as descriptor:
            if _mark(pid).startswith(leash):
                signal.pidfd_send_signal(descriptor, number)
                count += 1
    return count


def sweep_away(leash: str) -> None:
    """Kill all of them, those too that are being started meanwhile."""
    for _ in range(_MOST_SWEEPS):
        if not sweep(leash, signal.SIGKILL):
            return


def _pids() -> list[int]:
    ours = os.getpid()
    names = (path.name for path in _PROC.iterdir())
    return [pid for name in names if name.isdigit() and (pid := int(name)) != ours]


@contextlib.contextmanager
def _opened(pid: int) -> Iterator[int]:
    descriptor = os.pidfd_open(pid)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _mark(pid: int) -> str:
    """The mark of a process, empty where it has none; one that has ended has none either."""
    environment = (_PROC / str(pid) / "environ").read_bytes()
    for entry in environment.split(b"\0"):
        if entry.startswith(f"{MARK}=".encode()):
            return os.fsdecode(entry.partition(b"=")[2])
    return ""
