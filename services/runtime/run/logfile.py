"""One process's log file, which cannot grow without end."""

import errno
import os
from io import FileIO
from pathlib import Path

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
