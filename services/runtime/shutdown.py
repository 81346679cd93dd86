"""Signals that end a process: SIGINT, SIGTERM, and the death of its supervisor."""

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_LAST_WORDS = 1.0
"""Seconds that an orphan has to end by itself before it is ended."""
_ENDING = {
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
}


class ShutdownEvent:
    """Event that this process must end; kept even while no loop runs that it could stop."""

    def __init__(self) -> None:
        self._came = threading.Event()
        self._stop: Callable[[], None] | None = None

    def on_shutdown(self, stop: Callable[[], None]) -> None:
        """Call `stop` when the process must end, instead of any earlier callback."""
        first, self._stop = self._stop is None, stop
        if first:
            stop_on_signals(self._come)
        elif self._came.is_set():
            stop()

    def wait(self, seconds: float) -> bool:
        """Wait at most so many seconds; return whether the event has come."""
        return self._came.wait(seconds)

    def _come(self) -> None:
        self._came.set()
        if self._stop is not None:
            self._stop()


def stop_on_signals(stop: Callable[[], None]) -> None:
    """Call `stop` on SIGINT and SIGTERM."""

    # Set explicitly: a shell's `&` leaves SIGINT ignored, and children inherit that.
    def on_signal(_number: int, _frame: Any) -> None:
        stop()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)


def end_with_supervisor() -> None:
    """End this process from here on when the supervisor that started it dies, or has died."""
    if os.environ.get("QUADCTL_SUPERVISED"):
        die_with_parent()
        threading.Thread(target=_watch_parent, daemon=True).start()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay signals that end a process until the block is done, where the system allows it.

    An interrupted block would leave traces that look like those of another process.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def interruptible() -> None:
    """Take signals from here on; the command that became this process delayed them, if any did."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)


def _watch_parent() -> None:
    # The supervisor holds the other end of our stdin, which closes when the supervisor ends, even
    # by kill -9, on every platform, and even before die_with_parent() took effect.
    while os.read(0, 1):
        pass
    # This ends a process at once that has no loop to stop yet, e.g. while it waits for the hub.
    signal.raise_signal(signal.SIGTERM)
    time.sleep(_LAST_WORDS)
    os._exit(1)


def die_with_parent() -> None:
    """Make Linux kill this process with its parent: it may be frozen, or a user's command."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
