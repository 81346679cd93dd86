"""A log file read to its end and beyond, through what is done to it meanwhile."""

import os
from pathlib import Path
from typing import BinaryIO, Self


class Tail:
    """The lines of NAME.log, those of the older NAME.log.1 before them."""

    def __init__(self, path: Path) -> None:
        """Opens nothing yet; the file may come later."""
        self._path = path
        self._file: BinaryIO | None = None
        self._part = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def all(self) -> list[str]:
        """All lines that there are, from the file that was full before on."""
        lines = self.more()
        return [*self._old(), *lines]

    def more(self) -> list[str]:
        """The whole lines that have come since the last call, at first all."""
        found = b""
        if self._file is not None:
            found = self._rest(self._file)
            if self._is_file(self._file):
                return self._whole(found)
            # It was full and has another name now. What came while we looked is in it, too.
            found += self._rest(self._file)
            self._file.close()
            self._file = None
        try:
            self._file = self._path.open("rb")
        except FileNotFoundError:
            return self._whole(found)
        return self._whole(found + self._rest(self._file))

    def _old(self) -> list[str]:
        try:
            with self._path.with_name(f"{self._path.name}.1").open("rb") as old:
                # The one just read may have got that name meanwhile.
                return [] if self._file and _same(old, self._file) else _lines(old.read())
        except FileNotFoundError:
            return []

    def _rest(self, file: BinaryIO) -> bytes:
        if os.fstat(file.fileno()).st_size < file.tell():
            # Somebody has emptied it.
            file.seek(0)
            self._part = b""
        return file.read()

    def _is_file(self, file: BinaryIO) -> bool:
        try:
            with self._path.open("rb") as now:
                return _same(now, file)
        except FileNotFoundError:
            return True

    def _whole(self, fresh: bytes) -> list[str]:
        done, newline, self._part = (self._part + fresh).rpartition(b"\n")
        return _lines(done + newline)


def _lines(text: bytes) -> list[str]:
    return [line.decode(errors="replace") for line in text.split(b"\n")[:-1]]


def _same(one: BinaryIO, other: BinaryIO) -> bool:
    return os.path.sameopenfile(one.fileno(), other.fileno())
