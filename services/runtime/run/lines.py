"""What a child writes, as lines that wait to be shown: bounded, however much it writes."""

import time
from threading import Lock
from typing import NamedTuple

LONGEST = 4000
"""Bytes of a line that are kept; what goes beyond, up to the line's end, is left out."""
MOST = 500
"""Lines that may wait to be shown; more are dropped, and counted."""
FEW = 50
"""Lines at once that are nothing unusual; the reader pauses after more."""


class Said(NamedTuple):
    """A line, when it was read (Unix time, s), and by whom it was said."""

    at: float
    name: str
    line: str


class Lines:
    """Filled by the thread that reads a child's pipe, emptied by the supervisor's loop."""

    def __init__(self, name: str) -> None:
        """`name` is the child's."""
        self._name = name
        self._lock = Lock()
        self._waiting: list[Said] = []
        self._dropped = 0
        self._part = b""
        self._cutting = False

    def feed(self, chunk: bytes) -> bool:
        """Take in what was read; False where it was much, so that the reader shall pause."""
        pieces = chunk.split(b"\n")
        too_long = self._cutting
        if self._cutting:
            self._cutting = len(pieces) == 1
            del pieces[0]
        elif self._part:
            pieces[0] = self._part + pieces[0]
        self._part = pieces.pop() if pieces else b""
        if len(self._part) > LONGEST:
            # Shown now, for its end may never come.
            pieces.append(self._part)
            self._part, self._cutting = b"", True
        self._add(pieces)
        return len(pieces) <= FEW and not too_long

    def end(self) -> None:
        """Nothing more will come: what stands there without a newline is a line."""
        if self._part:
            self._add([self._part])
            self._part = b""

    def take(self) -> list[Said]:
        """The lines that wait; where some were dropped, the last one says how many."""
        # Most looks find none, and spare the lock; what comes just now is the next one's.
        if not self._waiting:
            return []
        with self._lock:
            taken, self._waiting = self._waiting, []
            dropped, self._dropped = self._dropped, 0
        if dropped:
            taken.append(Said(time.time(), self._name, f"... {dropped} lines dropped"))
        return taken

    def _add(self, pieces: list[bytes]) -> None:
        now = time.time()
        with self._lock:
            room = MOST - len(self._waiting)
            self._waiting += [Said(now, self._name, _text(piece)) for piece in pieces[:room]]
            self._dropped += max(len(pieces) - room, 0)


def _text(raw: bytes) -> str:
    text = raw[:LONGEST].decode(errors="replace").rstrip("\r")
    return text if len(raw) <= LONGEST else f"{text} ... (cut)"
