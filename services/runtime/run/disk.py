"""A disk that may be full: a fault ends nothing, is told once, and once more when it is over."""

import time
from collections.abc import Callable
from pathlib import Path

_PROBE_EVERY = 1.0
_ROOM = 1 << 16
"""Bytes that must fit before the fault counts as over, so that it does not come and go."""


class Disk:
    """Where a run writes: `folder`'s disk. `tell` shows a line without writing it anywhere."""

    def __init__(self, folder: Path, tell: Callable[[str], None]) -> None:
        self._folder, self._tell = folder, tell
        self._fault = False
        self._lost = 0
        self._next_probe = 0.0

    def keep(self, write: Callable[[], object]) -> bool:
        """Write, unless the disk has a fault; counts what could not be written."""
        if not self._fault and self.attempt(write):
            return True
        self._lost += 1
        return False

    def attempt(self, write: Callable[[], object]) -> bool:
        """Write, even to a disk with a fault; whether it went well."""
        try:
            write()
        except FileNotFoundError:
            # No fault of the disk: somebody has removed the folder, which the run's home mends.
            return False
        except OSError as error:
            if not self._fault:
                self._fault, self._next_probe = True, time.monotonic() + _PROBE_EVERY
                self._tell(
                    f"{self._folder} cannot be written: {error.strerror}; the run goes on, what it "
                    "says is only shown until the disk has room again"
                )
            return False
        return True

    def look(self, now: float) -> str:
        """Once in a while, see whether the fault is over; what is then to be said, else empty."""
        if not self._fault or now < self._next_probe:
            return ""
        self._next_probe = now + _PROBE_EVERY
        if not self.attempt(lambda: probe(self._folder)):
            return ""
        lost, self._fault, self._lost = self._lost, False, 0
        return f"{self._folder} can be written again; {lost} lines are not there"


def probe(folder: Path) -> None:
    """Raise OSError where the folder's disk has no room."""
    path = folder / ".room"
    try:
        path.write_bytes(bytes(_ROOM))
    finally:
        path.unlink(missing_ok=True)
