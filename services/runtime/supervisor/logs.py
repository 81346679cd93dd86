"""Log stream, rotating log files, handling of a full disk."""

import errno
import os
import time
from collections import deque
from collections.abc import Callable
from io import FileIO
from pathlib import Path

from quadctl.services.runtime.terminal import escaped

_PROBE_EVERY = 1.0
_ROOM = 1 << 16
"""Bytes that must fit before the fault counts as over, so that the state does not flicker."""


class DiskFault:
    """Fault state of the disk with `folder`; `log` shows a line without writing it to a file."""

    def __init__(self, folder: Path, log: Callable[[str], None]) -> None:
        self._folder, self._log = folder, log
        self._fault = False
        self._lost = 0
        self._next_probe = 0.0

    def write(self, write: Callable[[], object]) -> bool:
        """Call `write` unless the disk has a fault; returns success and counts failures."""
        if not self._fault and self.try_write(write):
            return True
        self._lost += 1
        return False

    def try_write(self, write: Callable[[], object]) -> bool:
        """Call `write` even if the disk has a fault, and return its success."""
        try:
            write()
        except FileNotFoundError:
            # Not a disk fault: the folder was removed, and RunDirectory repairs it.
            return False
        except OSError as error:
            if not self._fault:
                self._fault, self._next_probe = True, time.monotonic() + _PROBE_EVERY
                self._log(
                    f"{self._folder} cannot be written: {error.strerror}; the run continues, its "
                    "log is shown but not saved until the disk has room again"
                )
            return False
        return True

    def probe(self, now: float) -> str:
        """Check once a second whether the fault is over; returns a line to log, or an empty one."""
        if not self._fault or now < self._next_probe:
            return ""
        self._next_probe = now + _PROBE_EVERY
        if not self.try_write(lambda: probe(self._folder)):
            return ""
        lost, self._fault, self._lost = self._lost, False, 0
        return f"{self._folder} can be written again; {lost} lines were lost"


def probe(folder: Path) -> None:
    """Raise OSError if the folder's disk has no room."""
    path = folder / ".room"
    try:
        path.write_bytes(bytes(_ROOM))
    finally:
        path.unlink(missing_ok=True)


LARGEST = 4_000_000
"""Bytes of a log file. A full one replaces NAME.log.1: a process's logs take at most twice this."""


class LogFile:
    """Log file whose lines are written at once, whole or not at all; its methods raise OSError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: FileIO | None = None
        self._size = 0

    def write(self, line: str) -> None:
        """Append a line."""
        data = f"{line}\n".encode()
        if self._file is not None and self._size + len(data) > LARGEST:
            self.close()
            self._path.replace(self._path.with_name(f"{self._path.name}.1"))
        file = self._file or self._open()
        written = file.write(data)
        if written < len(data):
            file.truncate(self._size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._size += written

    def close(self) -> None:
        """Close the file; the next line opens it again."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _open(self) -> FileIO:
        self._path.parent.mkdir(exist_ok=True)
        self._file = FileIO(self._path, "a")
        self._size = self._file.tell()
        return self._file


_COLOURS = (36, 32, 33, 35, 34, 96, 92, 93)
_LAST_LINES = 20
ABOUT = "up: "
"""Begin of the supervisor's lines in the log of the process that they are about."""

Emit = Callable[[str, str, float], None]
"""Function that shows a process's line: name, line, Unix time (s) at which it was read."""


class Printer:
    """Printer of lines by a function that writes a text, in colour if wanted."""

    def __init__(self, write: Callable[[str], object], *, colour: bool) -> None:
        self._write, self._colour = write, colour
        self._names: dict[str, int] = {}

    def __call__(self, name: str, line: str, at: float) -> None:
        """Print one line."""
        stamp = f"{time.strftime('%H:%M:%S', time.localtime(at))}.{int(at * 1000) % 1000:03d}"
        head = f"{stamp} {name:8} |"
        if self._colour:
            number = self._names.setdefault(name, len(self._names))
            head = f"\033[{_COLOURS[number % len(_COLOURS)]}m{head}\033[0m"
        self._write(f"{head} {escaped(line)}\n")


class Logs:
    """Log of all processes: shows each line through `emit` and writes it to the process's file.

    A line is written at once, so that the last lines of a crashed run are saved.
    """

    def __init__(self, folder: Path, emit: Emit) -> None:
        self._folder, self._emit = folder, emit
        self._files: dict[str, LogFile] = {}
        self._last: dict[str, deque[str]] = {}
        self._earlier: dict[str, deque[str]] = {}
        self.disk = DiskFault(folder.parent, lambda line: emit("up", line, time.time()))

    def show(self, name: str, line: str, at: float | None = None, about: str = "") -> None:
        """Log one line of a process, read now or at `at` (Unix time, s).

        A line `about` another process is also written to that one's file, where its users look.
        """
        self._write(name, line)
        if about:
            self._write(about, f"{ABOUT}{line}")
        self._last.setdefault(name, deque(maxlen=_LAST_LINES)).append(line)
        self._emit(name, line, time.time() if at is None else at)

    def _write(self, name: str, line: str) -> None:
        if name not in self._files:
            self._files[name] = LogFile(self._folder / f"{name}.log")
        self.disk.write(lambda: self._files[name].write(line))

    def begin(self, name: str) -> None:
        """Note that a process is started again: its last lines are those of this attempt."""
        if name in self._last:
            self._earlier[name] = self._last[name]
            self._last[name] = deque(maxlen=_LAST_LINES)

    def look(self, now: float) -> None:
        """Check once a second whether the disk has room again."""
        if line := self.disk.probe(now):
            self.show("up", line)

    def last(self, name: str) -> str:
        """Return the last lines of a process, indented; without any, those of the attempt before."""
        lines = self._last.get(name) or self._earlier.get(name) or ()
        return "\n".join(f"  {line}" for line in lines)

    def close(self) -> None:
        """Close the files; a later line opens its file again, in the folder of that moment."""
        for file in self._files.values():
            file.close()
