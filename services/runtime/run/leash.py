"""Runs a stranger's command so that it ends when the supervisor dies, however it dies.

Our own nodes watch their stdin for that; a stranger's command knows nothing of it. On Linux the
kernel is asked to kill it; elsewhere it is up to the command to end when its stdin does. The
command takes this process's place, so its pid is the one that was started.
"""

import os
import sys

from services.runtime.ending import die_with_parent


def main(supervisor: int, command: list[str]) -> None:
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
    main(int(sys.argv[1]), sys.argv[2:])
