"""The three standard streams, whatever the shell has made of them."""

import os
import sys
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


def flush() -> None:
    """Write out what is left; raises QuadctlError where it cannot be."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise QuadctlError(
            f"the output cannot be written: {error.strerror}", "is its disk full?"
        ) from error
