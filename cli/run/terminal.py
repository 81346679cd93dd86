"""The terminal that a run is watched on, if it is one."""

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from typing import TextIO


def is_live() -> bool:
    """Whether somebody watches: a terminal that can move its cursor, and is ours to write on."""
    return _is_able() and is_ours()


def is_ours() -> bool:
    """Whether the terminal is this job's, or the shell has put it in the background (`&`)."""
    if sys.platform == "win32":
        return True
    try:
        return os.tcgetpgrp(sys.stdout.fileno()) == os.getpgrp()
    except OSError:
        # Not our session's, such as one that a test or a service manager has opened.
        return False


def has_colour() -> bool:
    """Whether to paint: by the convention of no-color.org."""
    return _is_able() and not os.environ.get("NO_COLOR")


def for_lines() -> TextIO:
    """Standard output for lines alone; says that it is no terminal where colour is not wanted."""
    if has_colour() or not sys.stdout.isatty():
        return sys.stdout
    return _Uncoloured(sys.stdout.buffer, encoding="utf-8", errors="replace")


class _Uncoloured(io.TextIOWrapper):
    def isatty(self) -> bool:
        return False


def _is_able() -> bool:
    return sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb"


@contextlib.contextmanager
def without_echo() -> Iterator[None]:
    """Keep keys pressed meanwhile from being written into what is drawn; they are dropped."""
    if sys.platform == "win32" or not sys.stdin.isatty() or not is_ours():
        yield
        return
    import termios

    kept = termios.tcgetattr(sys.stdin)
    quiet = [*kept[:3], kept[3] & ~termios.ECHO, *kept[4:]]
    termios.tcsetattr(sys.stdin, termios.TCSANOW, quiet)
    try:
        yield
    finally:
        # The terminal may be closed by now.
        with contextlib.suppress(termios.error):
            termios.tcsetattr(sys.stdin, termios.TCSAFLUSH, kept)
