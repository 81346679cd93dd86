"""Lock on a file, released by the kernel however its holder dies."""

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from typing import Self

from quadctl.services.runtime.errors import AlreadyServed

_A_LOOK = 0.05
"""Seconds for which another process's `held` may block the lock; that is no refusal."""
_LOOKERS = 2.0
"""Seconds for which many such checks, one after the other, may block it."""


class FileLock:
    """Lock on `what`, e.g. `realm lab`, for one process at a time; the file has its pid."""

    def __init__(self, path: str | os.PathLike[str], what: str, hint: str = "") -> None:
        self._path, self._what, self._hint = path, what, hint
        self._fd: int | None = None

    def acquire(self) -> Self:
        """Take the lock; raise AlreadyServed, naming the holder's pid, if it is taken."""
        started = time.monotonic()
        while (fd := self._attempt()) is None:
            waited = time.monotonic() - started
            if waited > _LOOKERS or (waited > _A_LOOK and self.held()):
                raise AlreadyServed(
                    f"{self._what} is already held by process {self._holder()}", self._hint
                )
            time.sleep(_A_LOOK / 10)
        self._fd = fd
        # On a full disk the file keeps no pid; the lock holds all the same.
        with contextlib.suppress(OSError):
            # Overwritten first, truncated after: on a full disk, room once freed may be lost.
            os.ftruncate(fd, os.write(fd, str(os.getpid()).encode()))
        return self

    def _attempt(self) -> int | None:
        fd = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
        if _try_lock(fd, alone=True) and self._is_file(fd):
            return fd
        os.close(fd)
        return None

    def _is_file(self, fd: int) -> bool:
        # A holder that ended may have removed the file while we opened it.
        with contextlib.suppress(FileNotFoundError):
            return os.fstat(fd).st_ino == os.stat(self._path).st_ino  # noqa: PTH116 - faster
        return False

    def _holder(self) -> str:
        try:
            with open(self._path) as file:  # noqa: PTH123 - pathlib is slow to import
                return file.read().strip() or "unknown"
        except FileNotFoundError:
            return "unknown"

    def __enter__(self) -> Self:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()

    def is_held_by_us(self) -> bool:
        """Return whether we hold the lock and its file: a removed one would let another in."""
        return self._fd is not None and self._is_file(self._fd)

    def held(self) -> bool:
        """Return whether any process, this one included, holds the lock now; create no file.

        Concurrent checks do not see each other, except on Windows, which has no shared locks.
        """
        return is_locked(self._path)

    def release(self) -> None:
        """Release the lock, if held."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None


def lock_open(fd: int) -> None:
    """Lock an open file until it is closed, if its disk has locks and nobody holds it."""
    with contextlib.suppress(OSError):
        _try_lock(fd, alone=True)


def is_locked(path: str | os.PathLike[str]) -> bool:
    """Return whether any process holds a lock on a file now; create none."""
    try:
        fd = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        return not _try_lock(fd, alone=False)
    except OSError:
        return False  # a disk without locks
    finally:
        os.close(fd)


@contextlib.contextmanager
def turn(path: str | os.PathLike[str]) -> Iterator[None]:
    """Wait until no other process is in such a block with this path, then run the block."""
    lock = FileLock(path, "the turn")
    while True:
        with contextlib.suppress(AlreadyServed):
            lock.acquire()
            break
        time.sleep(4 * _A_LOOK)
    try:
        yield
    finally:
        lock.release()


if sys.platform == "win32":
    import msvcrt

    _FAR_AWAY = 1 << 30
    """Offset of the locked byte, beyond the text: a Windows lock also prevents reading."""

    def _try_lock(fd: int, *, alone: bool) -> bool:  # noqa: ARG001 - no shared locks here
        os.lseek(fd, _FAR_AWAY, os.SEEK_SET)
        try:
            msvcrt.locking(fd, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        os.lseek(fd, 0, os.SEEK_SET)
        return True
else:
    import fcntl

    def _try_lock(fd: int, *, alone: bool) -> bool:
        kind = fcntl.LOCK_EX if alone else fcntl.LOCK_SH
        try:
            fcntl.flock(fd, kind | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True
