"""Runs a stranger's command so that it ends when the supervisor dies, however it dies.

Our own nodes watch their stdin for that; a stranger's command knows nothing of it. On Linux the
kernel is asked to kill it; elsewhere it is up to the command to end when its stdin does. The
command takes this process's place, so its pid is the one that was started.
"""

import os
import signal
import sys

_PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""


def main(supervisor: int, command: list[str]) -> None:
    """Become the command, on the supervisor's leash."""
    if sys.platform == "linux":
        import ctypes  # here alone: 8 ms, and only where prctl is

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != supervisor:
            # It died before the kernel was asked.
            sys.exit(1)
    try:
        os.execvp(command[0], command)  # noqa: S606 - the file names it, checked at launch
    except OSError as error:
        sys.exit(f"{command[0]} cannot be run: {error.strerror}")


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
