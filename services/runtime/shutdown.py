"""Signals to end a process: SIGINT, SIGTERM, and the death of its supervisor."""

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""
_LAST_WORDS = 1.0
"""How long (s) an orphan may take to end by itself before it is ended."""


class ShutdownEvent:
    """Whether this process is to end, whatever it is doing at the moment."""

    def __init__(self) -> None:
        self._came = threading.Event()
        self._stop: Callable[[], None] | None = None

    def on_shutdown(self, stop: Callable[[], None]) -> None:
        """Have `stop` called when the process is to end, in place of what was said before."""
        first, self._stop = self._stop is None, stop
        if first:
            stop_on_signals(self._come)
        elif self._came.is_set():
            stop()

    def wait(self, seconds: float) -> bool:
        """Wait for it that long; whether it has come."""
        return self._came.wait(seconds)

    def _come(self) -> None:
        self._came.set()
        if self._stop is not None:
            self._stop()


def stop_on_signals(stop: Callable[[], None]) -> None:
    """Call `stop` on SIGINT and SIGTERM, and when the supervisor that started us dies."""

    # Set explicitly: a shell's `&` leaves SIGINT ignored, and children inherit that.
    def on_signal(_number: int, _frame: Any) -> None:
        stop()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    if os.environ.get("QUADCTL_SUPERVISED"):
        die_with_parent()
        threading.Thread(target=_watch_parent, args=(stop,), daemon=True).start()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Have Ctrl-C wait until the block is done, where the system can make it wait.

    What it interrupts half done could not be told from what somebody else has done.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _watch_parent(stop: Callable[[], None]) -> None:
    # The supervisor holds the other end of our stdin: it ends when the supervisor does,
    # even by kill -9, on every platform.
    while os.read(0, 1):
        pass
    stop()
    time.sleep(_LAST_WORDS)
    os._exit(1)


def die_with_parent() -> None:
    """Ask the kernel, where it is Linux, to kill this process when its parent dies.

    A frozen process hears nothing else, and a stranger's command may not listen.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
