"""Entry point of the `quadctl` command. Ctrl-C is no error, not even during the imports."""

import _thread
import os
import sys
import time

_CTRL_C = 130
_LATER = 0.01
"""Seconds until a Ctrl-C that got lost is repeated."""


def main() -> None:
    """Run the command line and exit with its exit code."""
    sys.unraisablehook = _repeat_ctrl_c
    try:
        from quadctl.cli import command
    except KeyboardInterrupt:
        os._exit(_CTRL_C)
    command.main()


def _repeat_ctrl_c(lost: "sys.UnraisableHookArgs") -> None:
    """Send SIGINT again if it came where Python ignores exceptions, e.g. between two imports."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return

    def send() -> None:
        import signal  # takes 1 ms, which no other command has to spend

        time.sleep(_LATER)
        os.kill(os.getpid(), signal.SIGINT)

    # From a thread: here, too, the exception would be ignored.
    _thread.start_new_thread(send, ())


if __name__ == "__main__":
    main()
