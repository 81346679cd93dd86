"""Child process: its start and end, the reader of its pipe, its bounded line buffer."""

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
"""Bytes of a line that are kept; what goes beyond, up to the line's end, is left out."""
MOST = 500
"""Lines that may wait to be shown; more are dropped, and counted."""
FEW = 50
"""Lines at once that are nothing unusual; the reader pauses after more."""


_OLD_IMPORT = re.compile(r"ModuleNotFoundError: No module named '(schemas|services|cli)\b")


class LogLine(NamedTuple):
    """A line, when it was read (Unix time, s), and by whom it was said."""

    at: float
    name: str
    line: str


class LineBuffer:
    """Filled by the thread that reads a child's pipe, emptied by the supervisor's loop."""

    def __init__(self, name: str) -> None:
        """`name` is the child's."""
        self._name = name
        self._lock = Lock()
        self._waiting: list[LogLine] = []
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

    def take(self) -> list[LogLine]:
        """The lines that wait; where some were dropped, the last one says how many."""
        # Most looks find none, and spare the lock; what comes just now is the next one's.
        if not self._waiting:
            return []
        with self._lock:
            taken, self._waiting = self._waiting, []
            dropped, self._dropped = self._dropped, 0
        if dropped:
            taken.append(LogLine(time.time(), self._name, f"... {dropped} lines dropped"))
        return taken

    def _add(self, pieces: list[bytes]) -> None:
        now = time.time()
        with self._lock:
            room = MOST - len(self._waiting)
            lines = [line for piece in pieces[:room] for line in _explained(_text(piece))]
            self._waiting += [LogLine(now, self._name, line) for line in lines[:room]]
            self._dropped += max(len(pieces) - room, 0)


def _explained(line: str) -> tuple[str, ...]:
    """Return a line, and the new import behind an error that cannot name it: a node of an older release."""
    if not (old := _OLD_IMPORT.match(line)):
        return (line,)
    top = old[1]
    hint = f"hint: quadctl is one package now: write `from quadctl.{top}` for `from {top}`"
    return line, hint


def _text(raw: bytes) -> str:
    text = raw[:LONGEST].decode(errors="replace").rstrip("\r")
    return text if len(raw) <= LONGEST else f"{text} ... (cut)"


_LAST_WORDS = 0.2
"""Seconds to wait for what an ended process wrote last; a grandchild may keep the pipe open."""
_CHUNK = 1 << 16
_PAUSE = 0.1
"""Seconds that a child's pipe is left to fill where it writes much."""
_GATHER = 0.005
"""Seconds in which what a child says next is left to gather, so that few looks show many lines."""
_POLL = 0.002


class Child:
    """A running process. `on_lines` and `on_end` are called from a thread of its own."""

    def __init__(
        self,
        process: Process,
        environment: Mapping[str, str],
        folder: str,
        leash: str,
        on_lines: Callable[[], None],
        on_end: Callable[[], None],
    ) -> None:
        """Start it; by the leash, all that a user's command starts can be found."""
        self._on_lines, self._on_end = on_lines, on_end
        self._leash = f"{leash}{process.name}/" if process.stranger else ""
        self._lines = LineBuffer(process.name)
        self._group_is_gone = False
        # In a session of its own: Ctrl-C is the supervisor's to hear, and to pass on in order.
        # Our nodes watch their stdin: they end when we do, however we do.
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
                env={**os.environ, **environment, descendants.MARK: self._leash},
                cwd=folder,
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read, daemon=True)

    def listen(self) -> None:
        """Hear what it says, from now on; a thread more, after which nothing can be forked."""
        self._reader.start()

    def take_lines(self) -> list[LogLine]:
        """What it has said since the last look."""
        return self._lines.take()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._popen.pid

    def exit_code(self) -> int | None:
        """How it ended, None while it runs."""
        return self._popen.poll()

    def terminate(self) -> None:
        """Ask it, and what it started, to end."""
        self._signal(signal.SIGTERM)
        if self._leash:
            descendants.signal_all(self._leash, signal.SIGTERM)

    def kill(self) -> None:
        """End it, and what it started, at once; also when it has ended by itself."""
        self._signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
        if self._leash:
            descendants.kill_all(self._leash)

    def wait(self, timeout: float) -> bool:
        """Whether it, and its process group, have ended within so many seconds."""
        deadline = time.monotonic() + timeout
        try:
            self._popen.wait(max(timeout, 0))
        except subprocess.TimeoutExpired:
            return False
        while not (gone := not self._signal(0)) and time.monotonic() < deadline:
            time.sleep(_POLL)
        return gone

    def last_words(self) -> str:
        """Read to the end of what it wrote; returns how it ended."""
        if self._reader.ident is not None:
            self._reader.join(_LAST_WORDS)
        code = self._popen.poll()
        if code is None:
            return "still running"
        return f"exit {code}" if code >= 0 else signal.Signals(-code).name

    def _signal(self, number: int) -> bool:
        """Signal its process group; whether there still is one."""
        ended = self._popen.poll() is not None
        if sys.platform == "win32":
            if not ended:
                self._popen.send_signal(number)
            return not ended
        # A group outlives its first process, and keeps its number; once gone, others may have it.
        if not self._group_is_gone:
            try:
                os.killpg(self._popen.pid, number)
            except (ProcessLookupError, PermissionError):
                # Not permitted: what is left of it is another user's, or on macOS has ended.
                self._group_is_gone = ended
        return not self._group_is_gone

    def _read(self) -> None:
        pipe = self._popen.stdout
        assert pipe is not None  # noqa: S101 - a pipe, as asked for above
        with pipe:
            while chunk := os.read(pipe.fileno(), _CHUNK):
                few = self._lines.feed(chunk)
                self._on_lines()
                time.sleep(_GATHER if few else _PAUSE)
        self._lines.end()
        self._on_end()
