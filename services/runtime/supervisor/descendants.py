"""Descendants of a user's command: all die with the supervisor, and can be found and killed.

Our own nodes watch their stdin; a user's command does not. It is started through this module, which
has Linux kill it with the supervisor and then becomes the command, with the same pid; on other
systems the command has to end when its stdin closes.

Its descendants are found by a mark in their environment, which every session and parent passes on.
Not found: a process that has cleared its environment and left the command's process group
(`env -i setsid ..`), has overwritten it, or runs as another user. Without /proc only the process
group is reached. A watcher process kills the marked ones when the supervisor dies.
"""

import contextlib
import os
import signal
import sys
import time
from pathlib import Path

from quadctl.services.runtime.shutdown import die_with_parent
from quadctl.services.runtime.supervisor.fork import ForkedProcess

MARK = "QUADCTL_LEASH"
_PROC = Path("/proc")
_MOST_SWEEPS = 20
_STARTING, _NEW = 0.2, 5.0
"""Seconds for which a process that is just being loaded is waited for, and within which it may be."""


def new_mark() -> str:
    """Return a mark that no other run has; a command's mark appends its name."""
    return f"{os.getpid()}.{time.time_ns()}/"


def signal_all(mark: str, number: int) -> int:
    """Signal every other process with a mark that begins with `mark`, and return their number."""
    return _sweep(mark, number)[0]


def _sweep(mark: str, number: int) -> tuple[int, int]:
    """Signal as `signal_all`; return the number of those, and of processes that have no mark yet."""
    if sys.platform != "linux":
        return 0, 0
    try:
        count, starting, names = 0, 0, os.listdir(_PROC)  # noqa: PTH208 - pathlib is slow
    except OSError:
        return 0, 1  # no file is left to look with: look again
    for pid in [int(name) for name in names if name.isdigit() and name != str(os.getpid())]:
        with contextlib.suppress(OSError):
            # The descriptor stays with this process, even if its id is reused.
            descriptor = os.pidfd_open(pid)
            try:
                environment = _environment(pid)
                if _mark_in(environment).startswith(mark):
                    signal.pidfd_send_signal(descriptor, number)
                    count += 1
                elif not environment and _is_new(pid):
                    starting += 1
            finally:
                os.close(descriptor)
    return count, starting


def kill_all(mark: str) -> None:
    """Kill all marked processes, also those started while this runs."""
    for _ in range(_MOST_SWEEPS):
        count, starting = _sweep(mark, signal.SIGKILL)
        if not count and not starting:
            return
        if not count:
            time.sleep(_STARTING / _MOST_SWEEPS)


def _environment(pid: int) -> bytes:
    """Return the environment of a process; empty of one that the kernel is just loading."""
    return (_PROC / str(pid) / "environ").read_bytes()


def _is_new(pid: int) -> bool:
    """Return whether a process has begun so lately that it may still be loaded."""
    from quadctl.services.runtime.procfs import stats_of

    stats = stats_of(pid)
    return (stats.state or "X") not in "ZX" and (stats.uptime or 0.0) < _NEW


def _mark_in(environment: bytes) -> str:
    """Return the mark in a process's environment; empty if it has none."""
    for entry in environment.split(b"\0"):
        if entry.startswith(f"{MARK}=".encode()):
            return os.fsdecode(entry.partition(b"=")[2])
    return ""


_WATCHED = f"{MARK}_WATCHED"


def watch(mark: str) -> ForkedProcess:
    """Start a watcher that kills the marked processes when we close its stdin or die."""
    return ForkedProcess(
        "quadctl.services.runtime.supervisor.descendants", {_WATCHED: mark}, "/", both=True
    )


def reap() -> None:
    """Wait for the supervisor's end, then kill the marked processes."""
    while os.read(0, 1):
        pass
    kill_all(os.environ[_WATCHED])


def exec_bound(supervisor: int, command: list[str]) -> None:
    """Replace this process by the command, which dies with the supervisor."""
    die_with_parent()
    if os.getppid() != supervisor:
        # The supervisor died before die_with_parent() took effect.
        sys.exit(1)
    try:
        os.execvp(command[0], command)  # noqa: S606 - the file names it, checked at launch
    except OSError as error:
        sys.exit(f"{command[0]} cannot be run: {error.strerror}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        exec_bound(int(sys.argv[1]), sys.argv[2:])
    else:
        reap()
