"""Writer of `up` in the foreground: its stdout, written by a thread."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Self, TextIO

_MOST = 2000
"""Lines that may wait for the reader; of more the oldest are dropped and counted."""
_LAST_WAIT = 1.0
"""Seconds at the end in which the reader may read what is left."""
_POLL = 0.05


class BackgroundWriter:
    """Stream for a `with` block. A reader that does not read, e.g. after Ctrl-S, delays no caller."""

    def __init__(self, stream: TextIO, framed: Callable[[str], str] = str) -> None:
        """`framed` adds to the text that is due, which may be empty, e.g. a table below it."""
        # Unbuffered: a thread that is stuck in a write keeps the lock of a buffer, even at the end.
        self._file = open(stream.fileno(), "wb", buffering=0, closefd=False)  # noqa: SIM115
        self._encoding, self._framed = stream.encoding, framed
        self._lines: deque[str] = deque()
        self._changed = threading.Condition()
        self._dropped = self._asked = self._done = 0
        self._has_reader, self._thread = True, threading.Thread(target=self._run, daemon=True)

    def write(self, line: str = "") -> None:
        """Write a line soon, after all earlier ones; an empty text renews what `framed` adds."""
        with self._changed:
            if self._thread.ident is None:
                # Not earlier: a process with threads cannot fork its nodes.
                self._thread.start()
            if line:
                self._lines.append(line)
            if len(self._lines) > _MOST:
                self._lines.popleft()
                self._dropped += 1
            self._asked += 1
            self._changed.notify_all()

    def check(self) -> None:
        """Raise BrokenPipeError if the reader has closed the pipe."""
        if not self._has_reader:
            raise BrokenPipeError

    def _run(self) -> None:
        done = 0
        while True:
            with self._changed:
                self._done = done
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._asked > self._done)
                done, dropped, text = self._asked, self._dropped, "".join(self._lines)
                self._dropped = 0
                self._lines.clear()
            notice = f"... {dropped} lines dropped\n" if dropped else ""
            data = self._framed(notice + text).encode(self._encoding, "replace")
            try:
                while data:
                    if written := self._file.write(data):
                        data = data[written:]
                    else:  # full, and in non-blocking mode
                        time.sleep(_POLL)
            except BrokenPipeError:
                self._has_reader = False
            except OSError:
                # A closed terminal or full disk must not end the run: the log files have the lines.
                continue

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._done == self._asked, _LAST_WAIT)
