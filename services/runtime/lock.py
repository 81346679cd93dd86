"""A lock that the kernel releases when its holder dies, however it dies."""

import contextlib
import os
import sys
import time
from pathlib import Path
from typing import Self

from services.runtime.errors import AlreadyServed

_A_LOOK = 0.05
"""Seconds: who looks whether the lock is held has it for a moment, which is no refusal."""


class FileLock:
    """Held by one process at a time; the file says by whom."""

    def __init__(self, path: Path, what: str, hint: str = "") -> None:
        """`what` names the thing locked, for the error: `realm lab`, `node safety`."""
        self._path, self._what, self._hint = path, what, hint
        self._fd: int | None = None

    def acquire(self) -> Self:
        """Take the lock; raises AlreadyServed, naming the holder's pid, if it is taken."""
        deadline = time.monotonic() + _A_LOOK
        while (fd := self._attempt()) is None:
            if time.monotonic() > deadline:
                raise AlreadyServed(
                    f"{self._what} is already held by process {self._holder()}", self._hint
                )
            time.sleep(_A_LOOK / 10)
        os.ftruncate(fd, 0)
        os.lseek(fd, 0, os.SEEK_SET)
        os.write(fd, str(os.getpid()).encode())
        self._fd = fd
        return self

    def _attempt(self) -> int | None:
        fd = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
        if _try_lock(fd) and self._is_file(fd):
            return fd
        os.close(fd)
        return None

    def _is_file(self, fd: int) -> bool:
        # A holder that ended may have removed the file while we opened it.
        with contextlib.suppress(FileNotFoundError):
            return os.fstat(fd).st_ino == self._path.stat().st_ino
        return False

    def _holder(self) -> str:
        with contextlib.suppress(FileNotFoundError):
            return self._path.read_text().strip() or "unknown"
        return "unknown"

    def __enter__(self) -> Self:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()

    def held(self) -> bool:
        """Whether any process, this one included, holds the lock now; creates no file."""
        try:
            fd = os.open(self._path, os.O_RDWR)
        except FileNotFoundError:
            return False
        try:
            return not _try_lock(fd)
        finally:
            os.close(fd)

    def release(self) -> None:
        """Let go; does nothing when not held."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None


if sys.platform == "win32":
    import msvcrt

    _FAR_AWAY = 1 << 30
    """Windows locks bar reading too, so a byte beyond the text is locked."""

    def _try_lock(fd: int) -> bool:
        os.lseek(fd, _FAR_AWAY, os.SEEK_SET)
        try:
            msvcrt.locking(fd, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
else:
    import fcntl

    def _try_lock(fd: int) -> bool:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True
