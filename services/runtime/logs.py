"""The log stream: each line with its time and its process's name, on a stream and in files."""

import sys
import time
from collections import deque
from pathlib import Path
from typing import TextIO

_COLOURS = (36, 32, 33, 35, 34, 96, 92, 93)
_LAST_LINES = 20


class Logs:
    """Shows lines on `stream`, coloured on a terminal, and keeps a file per process.

    A line's file is written at once, so that what a crashed run said last is there.
    """

    def __init__(self, folder: Path, stream: TextIO = sys.stdout) -> None:
        folder.mkdir(exist_ok=True)
        self._folder, self._stream = folder, stream
        self._files: dict[str, TextIO] = {}
        self._last: dict[str, deque[str]] = {}
        self._colour = stream.isatty()

    def show(self, name: str, line: str) -> None:
        """Log one line of a process."""
        if name not in self._files:
            path = self._folder / f"{name}.log"
            self._files[name] = path.open("a", encoding="utf-8", buffering=1)
            self._last[name] = deque(maxlen=_LAST_LINES)
        self._files[name].write(f"{line}\n")
        self._last[name].append(line)
        now = time.time()
        stamp = f"{time.strftime('%H:%M:%S', time.localtime(now))}.{int(now * 1000) % 1000:03d}"
        head = f"{stamp} {name:8} |"
        if self._colour:
            colour = _COLOURS[list(self._files).index(name) % len(_COLOURS)]
            head = f"\033[{colour}m{head}\033[0m"
        self._stream.write(f"{head} {line}\n")
        self._stream.flush()

    def last(self, name: str) -> str:
        """What a process said last, indented."""
        return "\n".join(f"  {line}" for line in self._last.get(name, ()))
