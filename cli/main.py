"""Entry point of the `quadctl` command. Ctrl-C is no error, not even during the imports."""

import _signal  # `signal` imports `enum`, which takes 5 ms
import os

_CTRL_C = 130


def main() -> None:
    """Run the command line and exit with its exit code."""
    if hasattr(_signal, "pthread_sigmask"):
        # Python ignores what is raised in some callbacks of an import, so that a Ctrl-C could get
        # lost there: it waits until the imports are done.
        _signal.pthread_sigmask(_signal.SIG_BLOCK, {_signal.SIGINT})
    try:
        from quadctl.cli import command
    except KeyboardInterrupt:
        os._exit(_CTRL_C)
    command.main()


if __name__ == "__main__":
    main()
