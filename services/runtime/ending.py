"""How a process learns that it shall end."""

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

_PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""
_LAST_WORDS = 1.0
"""How long (s) an orphan may take to end by itself before it is ended."""


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
