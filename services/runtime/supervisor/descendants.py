"""Everything that a user's command starts: bound to the supervisor's life, found and killed.

Our own nodes watch their stdin; a user's command knows nothing of that. It is started through this
module, which has Linux kill it with the supervisor and then becomes the command, with the same pid;
on other systems the command has to end when its stdin does.

What it starts in turn is found by a mark in its environment, inherited in whatever session and under
whatever parent. Not found: a process that has cleared its environment and left the command's process
group (`env -i setsid ..`), has overwritten it, or runs as another user. Without /proc only the
process group is reached. A watcher beside such commands kills the marked ones with the supervisor.
"""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from quadctl.services.runtime.shutdown import die_with_parent
from quadctl.services.runtime.supervisor.fork import ForkedProcess

MARK = "QUADCTL_LEASH"
_PROC = Path("/proc")
_MOST_SWEEPS = 20


def new_mark() -> str:
    """A mark that no other run has; a command's own adds its name."""
    return f"{os.getpid()}.{time.time_ns()}/"


def signal_all(leash: str, number: int) -> int:
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


def kill_all(leash: str) -> None:
    """Kill all of them, those too that are being started meanwhile."""
    for _ in range(_MOST_SWEEPS):
        if not signal_all(leash, signal.SIGKILL):
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


_WATCHED = f"{MARK}_WATCHED"


def watch(leash: str) -> ForkedProcess:
    """Start a watcher; it kills the marked when our end of its stdin closes, however that comes."""
    return ForkedProcess(
        "quadctl.services.runtime.supervisor.descendants", {_WATCHED: leash}, "/", both=True
    )


def reap() -> None:
    """Wait for the supervisor's end."""
    while os.read(0, 1):
        pass
    kill_all(os.environ[_WATCHED])


def exec_bound(supervisor: int, command: list[str]) -> None:
    """Become the command, on the supervisor's leash."""
    die_with_parent()
    if os.getppid() != supervisor:
        # It died before the kernel was asked.
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
