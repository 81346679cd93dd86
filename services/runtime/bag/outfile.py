"""The end of a file that grows by whole pieces: what the disk does not take is not there."""

import contextlib
import os
from pathlib import Path


class Outfile:
    """Collects what is written until `flush`, which puts all of it into the file, or nothing."""

    def __init__(self, descriptor: int) -> None:
        """Write to an open file, from its beginning on."""
        self.size = 0
        self._descriptor = descriptor
        self._pending = bytearray()

    @classmethod
    def create(cls, path: Path) -> "Outfile":
        """Make the file; raises OSError, FileExistsError where it is there already."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        return cls(os.open(path, flags, 0o666))

    def write(self, data: bytes) -> int:
        """Put something at the end, at the next `flush`."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Where the next byte goes."""
        return self.size + len(self._pending)

    def flush(self) -> None:
        """Hand it to the system, after which only that can lose it.

        Raises OSError, and leaves the file as it was, where the disk has no room.
        """
        rest = memoryview(bytes(self._pending))
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            # What is not a file on a disk cannot be cut, and has nothing that could be read again.
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self.size)
            raise
        self.size += len(self._pending)
        self._pending.clear()

    def close(self) -> None:
        """Let go of the file."""
        os.close(self._descriptor)
