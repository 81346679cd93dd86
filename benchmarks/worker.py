"""Loop of a measuring process: requests on stdin, answers on stdout.

Standard library only: the ROS side runs it too, under another Python.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any, NoReturn


def serve(**verbs: Callable[..., Any]) -> NoReturn:
    """Answer each JSON line with another until stdin ends; then exit, even if threads still run."""
    print(json.dumps("ready"), flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        answer = verbs[asked.pop("do")](**asked)
        print(json.dumps(answer), flush=True)
    os._exit(0)


def timed(call: Callable[[], object], count: int) -> list[float]:
    """Return the seconds of each of `count` calls."""
    times = []
    for _ in range(count):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return times


def paced(put: Callable[[int], object], count: int, hz: float) -> None:
    """Call `put` with a running number, `count` times at `hz`."""
    start = time.monotonic()
    for number in range(count):
        left = start + number / hz - time.monotonic()
        if left > 0:
            time.sleep(left)
        put(number)


def flood(put: Callable[[int], object], seconds: float) -> int:
    """Call `put` without pause; return the number of calls."""
    number, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        for _ in range(50):
            put(number)
            number += 1
    return number


class Arrivals:
    """Arrival times and ages of messages, both in seconds."""

    def __init__(self) -> None:
        self._ages: list[float] = []
        self._times: list[float] = []

    def add(self, sent: float) -> None:
        """Add a message with its send time by the monotonic clock."""
        now = time.monotonic()
        self._times.append(now)
        self._ages.append(now - sent)

    def take(self, count: int, within: float = 1.0) -> list[float]:
        """Return the ages (s) of received messages; wait for `count` of them, at most `within` s."""
        deadline = time.monotonic() + within
        while len(self._ages) < count and time.monotonic() < deadline:
            time.sleep(0.005)
        ages = self._ages[:]
        self._clear()
        return ages

    def rate(self, quiet: float = 0.3) -> tuple[int, float]:
        """Return the number of messages, and messages a second from the first to the last.

        Waits until none came for `quiet` s.
        """
        seen = -1
        while seen != len(self._times):
            seen = len(self._times)
            time.sleep(quiet)
        times = self._times[:]
        self._clear()
        count = len(times)
        return count, (count - 1) / (times[-1] - times[0]) if count > 1 else 0.0

    def _clear(self) -> None:
        self._ages.clear()
        self._times.clear()
