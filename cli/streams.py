"""The three standard streams, whatever the shell has made of them."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from services.runtime.errors import QuadctlError


def ensure() -> None:
    """Open what the shell has closed (`<&-`), lest a socket take its number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is this one.
            os.open(os.devnull, os.O_RDWR)
    if sys.stdout is None:
        sys.stdout = _nowhere()
    if sys.stderr is None:
        sys.stderr = _nowhere()


def _nowhere() -> TextIO:
    return os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")


def say(text: str) -> None:
    """Write to stdout at once; raises as flush."""
    with _written():
        sys.stdout.write(text)
        sys.stdout.flush()


def flush() -> None:
    """Write out what is left; raises QuadctlError where it cannot be."""
    with _written():
        sys.stdout.flush()
        sys.stderr.flush()


def ensure_read() -> None:
    """Raise BrokenPipeError where who read our stdout through a pipe has left."""
    import select

    if hasattr(select, "poll"):
        poll = select.poll()
        poll.register(1, 0)  # only what is told unasked
        if any(events & select.POLLERR for _, events in poll.poll(0)):
            raise BrokenPipeError


@contextmanager
def _written() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        # What could not be written is kept, and would be tried again at the very end.
        sys.stdout = _nowhere()
        raise QuadctlError(
            f"the output cannot be written: {error.strerror}",
            "is its disk full? What was asked for may be done all the same",
        ) from error
