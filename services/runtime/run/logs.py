"""The log stream: each line with its time and its process's name, shown and kept in files."""

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TextIO

from services.runtime.run.disk import Disk
from services.runtime.run.logfile import LogFile

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
        self.disk = Disk(folder.parent, lambda line: emit("up", line, time.time()))

    def show(self, name: str, line: str, at: float | None = None) -> None:
        """Log one line of a process, read now or at `at` (Unix time, s)."""
        if name not in self._files:
            self._files[name] = LogFile(self._folder / f"{name}.log")
            self._last[name] = deque(maxlen=_LAST_LINES)
        file = self._files[name]
        self.disk.keep(lambda: file.write(line))
        self._last[name].append(line)
        self._emit(name, line, time.time() if at is None else at)

    def look(self, now: float) -> None:
        """Once in a while, see whether the disk has room again."""
        if said := self.disk.look(now):
            self.show("up", said)

    def last(self, name: str) -> str:
        """What a process said last, indented."""
        return "\n".join(f"  {line}" for line in self._last.get(name, ()))

    def close(self) -> None:
        """Let go of the files; a later line opens its own anew, where its folder is then."""
        for file in self._files.values():
            file.close()
