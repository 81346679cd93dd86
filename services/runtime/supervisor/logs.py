"""Log stream, rotating files, full-disk handling."""

import errno
import os
import time
from collections import deque
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import TextIO

_PROBE_EVERY = 1.0
_ROOM = 1 << 16
"""Bytes that must fit before the fault counts as over, so that it does not come and go."""


class DiskFault:
    """Where a run writes: `folder`'s disk. `tell` shows a line without writing it anywhere."""

    def __init__(self, folder: Path, tell: Callable[[str], None]) -> None:
        self._folder, self._tell = folder, tell
        self._fault = False
        self._lost = 0
        self._next_probe = 0.0

    def write(self, write: Callable[[], object]) -> bool:
        """Write, unless the disk has a fault; counts what could not be written."""
        if not self._fault and self.try_write(write):
            return True
        self._lost += 1
        return False

    def try_write(self, write: Callable[[], object]) -> bool:
        """Write, even to a disk with a fault; whether it went well."""
        try:
            write()
        except FileNotFoundError:
            # No fault of the disk: somebody has removed the folder, which RunDirectory repairs.
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

    def probe(self, now: float) -> str:
        """Once in a while, see whether the fault is over; what is then to be said, else empty."""
        if not self._fault or now < self._next_probe:
            return ""
        self._next_probe = now + _PROBE_EVERY
        if not self.try_write(lambda: probe(self._folder)):
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


LARGEST = 4_000_000
"""Bytes of a log file. A full one becomes NAME.log.1, in place of the one before: a process's
logs take twice this at most."""


class LogFile:
    """Appends lines; each is written at once, whole or not at all. Methods raise OSError."""

    def __init__(self, path: Path) -> None:
        """Touches nothing yet."""
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
        """Let go of the file; the next line opens it anew."""
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

Emit = Callable[[str, str, float], None]
"""Shows a process's line: its name, the line, and when it was read (Unix time, s)."""


class Printer:
    """Shows lines on a text stream, coloured on a terminal."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._colour = stream, stream.isatty()
        self._names: dict[str, int] = {}
        self._reader_left = False

    def __call__(self, name: str, line: str, at: float) -> None:
        """Show one line; raises BrokenPipeError, once, when nobody reads any more."""
        stamp = f"{time.strftime('%H:%M:%S', time.localtime(at))}.{int(at * 1000) % 1000:03d}"
        head = f"{stamp} {name:8} |"
        if self._colour:
            number = self._names.setdefault(name, len(self._names))
            head = f"\033[{_COLOURS[number % len(_COLOURS)]}m{head}\033[0m"
        if self._reader_left:
            return
        try:
            self._stream.write(f"{head} {line}\n")
            self._stream.flush()
        except BrokenPipeError:
            self._reader_left = True
            raise
        except OSError:
            # A closed terminal, or a file on a full disk, is no reason to fall: the line's own
            # file has it, or the disk's fault was told.
            return


class Logs:
    """Shows each line through `emit`, and keeps a file per process.

    A line's file is written at once, so that what a crashed run said last is there.
    """

    def __init__(self, folder: Path, emit: Emit) -> None:
        self._folder, self._emit = folder, emit
        self._files: dict[str, LogFile] = {}
        self._last: dict[str, deque[str]] = {}
        self.disk = DiskFault(folder.parent, lambda line: emit("up", line, time.time()))

    def show(self, name: str, line: str, at: float | None = None) -> None:
        """Log one line of a process, read now or at `at` (Unix time, s)."""
        if name not in self._files:
            self._files[name] = LogFile(self._folder / f"{name}.log")
            self._last[name] = deque(maxlen=_LAST_LINES)
        file = self._files[name]
        self.disk.write(lambda: file.write(line))
        self._last[name].append(line)
        self._emit(name, line, time.time() if at is None else at)

    def look(self, now: float) -> None:
        """Once in a while, see whether the disk has room again."""
        if said := self.disk.probe(now):
            self.show("up", said)

    def last(self, name: str) -> str:
        """What a process said last, indented."""
        return "\n".join(f"  {line}" for line in self._last.get(name, ()))

    def close(self) -> None:
        """Let go of the files; a later line opens its own anew, where its folder is then."""
        for file in self._files.values():
            file.close()
