"""Child process: start and end, reader of its pipe, bounded line buffer."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from threading import Lock
from typing import NamedTuple

from quadctl.services.runtime.process_table import Process
from quadctl.services.runtime.supervisor import descendants, fork
from quadctl.services.runtime.supervisor.fork import ForkedProcess

LONGEST = 4000
"""Bytes of a line that are kept; the rest of a longer line is dropped."""
MOST = 500
"""Lines that may wait to be shown; more are dropped and counted."""
FEW = 50
"""Lines per read that are normal; after more the reader pauses."""

_OLD_IMPORT = re.compile(r"ModuleNotFoundError: No module named '(schemas|services|cli)\b")


class LogLine(NamedTuple):
    """A line, with the Unix time (s) at which it was read and the name of its process.

    A line of the supervisor's may be `about` another process.
    """

    at: float
    name: str
    line: str
    about: str = ""


class LineBuffer:
    """Lines of the child `name`, from the reader thread of its pipe to the supervisor's loop."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = Lock()
        self._waiting: list[LogLine] = []
        self._dropped = 0
        self._part = b""
        self._cutting = False

    def feed(self, chunk: bytes) -> bool:
        """Add the bytes read; return False if there were many, so that the reader pauses."""
        pieces = chunk.split(b"\n")
        too_long = self._cutting
        if self._cutting:
            self._cutting = len(pieces) == 1
            del pieces[0]
        elif self._part:
            pieces[0] = self._part + pieces[0]
        self._part = pieces.pop() if pieces else b""
        if len(self._part) > LONGEST:
            # Show it now, because its newline may never come.
            pieces.append(self._part)
            self._part, self._cutting = b"", True
        self._add(pieces)
        return len(pieces) <= FEW and not too_long

    def end(self) -> None:
        """Add the rest, which has no newline, as the last line."""
        if self._part:
            self._add([self._part])
            self._part = b""

    def take(self) -> list[LogLine]:
        """Return the lines that wait; if some were dropped, the last one gives their number."""
        # Usually there is none: skip the lock. A line added just now waits for the next call.
        if not self._waiting:
            return []
        with self._lock:
            lines, self._waiting = self._waiting, []
            dropped, self._dropped = self._dropped, 0
        if dropped:
            lines.append(LogLine(time.time(), self._name, f"... {dropped} lines dropped"))
        return lines

    def _add(self, pieces: list[bytes]) -> None:
        now = time.time()
        with self._lock:
            room = MOST - len(self._waiting)
            lines = [line for piece in pieces[:room] for line in _explained(_text(piece))]
            self._waiting += [LogLine(now, self._name, line) for line in lines[:room]]
            self._dropped += max(len(pieces) - room, 0)


def _explained(line: str) -> tuple[str, ...]:
    """Return a line; after a failed import of a node for an older release, also a hint."""
    if not (old := _OLD_IMPORT.match(line)):
        return (line,)
    top = old[1]
    return line, f"hint: quadctl is one package now: write `from quadctl.{top}` for `from {top}`"


def _text(raw: bytes) -> str:
    text = raw[:LONGEST].decode(errors="replace").rstrip("\r")
    return text if len(raw) <= LONGEST else f"{text} ... (cut)"


_LAST_WORDS = 0.2
"""Seconds to wait for the last output of an ended process; a grandchild may hold the pipe."""
_CHUNK = 1 << 16
_PAUSE = 0.1
"""Seconds between reads from a child that writes much."""
_GATHER = 0.005
"""Seconds between reads otherwise, so that each wake-up of the loop shows several lines."""
_POLL = 0.002


class Child:
    """A running process. Its reader thread calls `on_lines` and `on_end`."""

    def __init__(
        self,
        process: Process,
        environment: Mapping[str, str],
        folder: str,
        mark: str,
        on_lines: Callable[[], None],
        on_end: Callable[[], None],
    ) -> None:
        """Start the process; the mark finds all processes that a user's command starts."""
        self._on_lines, self._on_end = on_lines, on_end
        self._mark = f"{mark}{process.name}/" if process.stranger else ""
        self._lines = LineBuffer(process.name)
        self._group_is_gone = False
        # A new session: only the supervisor receives Ctrl-C, and ends its children in order.
        # Our nodes watch their stdin, so they end with the supervisor even after a kill -9.
        self._popen: subprocess.Popen[bytes] | ForkedProcess
        if not process.stranger and fork.possible():
            self._popen = ForkedProcess(process.command[-1], environment, folder, both=True)
        else:
            holder = (sys.executable, "-P", "-m", descendants.__name__, str(os.getpid()))
            self._popen = subprocess.Popen(
                (*holder, *process.command) if process.stranger else process.command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={**os.environ, **environment, descendants.MARK: self._mark},
                cwd=folder,
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read, daemon=True)

    def listen(self) -> None:
        """Start the reader thread, after which this process cannot fork any more."""
        self._reader.start()

    def take_lines(self) -> list[LogLine]:
        """Return its output since the last call."""
        return self._lines.take()

    @property
    def pid(self) -> int:
        """Return its process id."""
        return self._popen.pid

    def exit_code(self) -> int | None:
        """Return its exit code, None while it runs."""
        return self._popen.poll()

    def terminate(self) -> None:
        """Send SIGTERM to it and to its descendants."""
        self._signal(signal.SIGTERM)
        if self._mark:
            descendants.signal_all(self._mark, signal.SIGTERM)

    def kill(self) -> None:
        """Kill it and its descendants, also after it has ended by itself."""
        self._signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
        if self._mark:
            descendants.kill_all(self._mark)

    def wait(self, timeout: float) -> bool:
        """Return whether it and its process group have ended within `timeout` (s)."""
        deadline = time.monotonic() + timeout
        try:
            self._popen.wait(max(timeout, 0))
        except subprocess.TimeoutExpired:
            return False
        while not (gone := not self._signal(0)) and time.monotonic() < deadline:
            time.sleep(_POLL)
        return gone

    def last_words(self) -> str:
        """Wait until its last output is read, and return how it ended."""
        if self._reader.ident is not None:
            self._reader.join(_LAST_WORDS)
        code = self._popen.poll()
        if code is None:
            return "still running"
        return f"exit {code}" if code >= 0 else signal.Signals(-code).name

    def _signal(self, number: int) -> bool:
        """Signal its process group; returns whether the group still exists."""
        ended = self._popen.poll() is not None
        if sys.platform == "win32":
            if not ended:
                self._popen.send_signal(number)
            return not ended
        # A group can outlive its first process; after its end others may get its number.
        if not self._group_is_gone:
            try:
                os.killpg(self._popen.pid, number)
            except (ProcessLookupError, PermissionError):
                # PermissionError: the rest belongs to another user, or on macOS has ended.
                self._group_is_gone = ended
        return not self._group_is_gone

    def _read(self) -> None:
        pipe = self._popen.stdout
        assert pipe is not None  # noqa: S101 - Popen was given PIPE
        with pipe:
            while chunk := os.read(pipe.fileno(), _CHUNK):
                few = self._lines.feed(chunk)
                self._on_lines()
                time.sleep(_GATHER if few else _PAUSE)
        self._lines.end()
        self._on_end()
