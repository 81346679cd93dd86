"""Entry point of the `quadctl` command. Ctrl-C is no error, and never gets lost.

Python ignores what is raised in some callbacks of an import, and msgspec what is raised in the functions
that it calls to read a type. There a Ctrl-C has to wait until these have returned.
"""

import _signal  # `signal` imports `enum`, which takes 5 ms
import os
import sys

TYPE_CHECKING = False  # type checkers know the name; importing typing takes 15 ms

if TYPE_CHECKING:
    from types import FrameType

_CTRL_C = 130
_DEAF = frozenset(
    ("_frozen_importlib", "importlib._bootstrap", "typing", "typing_extensions", "msgspec._utils")
)
"""Modules with functions that are called where nothing may be raised."""
_AGAIN = 0.002
"""Seconds until a Ctrl-C that came in one of them comes again."""


def main() -> None:
    """Run the command line and exit with its exit code."""
    can_wait = hasattr(_signal, "setitimer")
    # Set explicitly: a shell's `&` leaves SIGINT ignored.
    _signal.signal(_signal.SIGINT, _interrupt if can_wait else _signal.default_int_handler)
    if can_wait:
        _signal.signal(
            _signal.SIGALRM, lambda _number, _frame: _signal.raise_signal(_signal.SIGINT)
        )
        sys.unraisablehook = _ignored
        # Until the imports are done: a command could be over before it comes again.
        _signal.pthread_sigmask(_signal.SIG_BLOCK, {_signal.SIGINT})
    try:
        from quadctl.cli import command

        command.main()
    except KeyboardInterrupt:
        os._exit(_CTRL_C)


def _interrupt(_number: int, frame: "FrameType | None") -> None:
    while frame is not None:
        if frame.f_globals.get("__name__") in _DEAF:
            _come_again()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _ignored(ignored: "sys.UnraisableHookArgs") -> None:
    """Report what was raised where Python ignores it, but let a Ctrl-C come again."""
    if ignored.exc_type is KeyboardInterrupt:
        _come_again()
    else:
        sys.__unraisablehook__(ignored)


def _come_again() -> None:
    _signal.setitimer(_signal.ITIMER_REAL, _AGAIN)


if __name__ == "__main__":
    main()
