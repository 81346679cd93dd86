"""The one thread that touches a service's state, and the inbox through which others reach it."""

import math
import time
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue

_LATE = 0.1
"""A loop that is later than this (s) drops the ticks it missed instead of hurrying after them."""


class Loop:
    """Serves an inbox between ticks, so that a call is answered on arrival.

    Zenoh's threads only post to it, and a handler never runs beside another.
    """

    def __init__(self) -> None:
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._sources: list[Callable[[], None]] = []
        self._retimed = False
        self._waits = 0
        self.stopping = False

    @property
    def waits(self) -> bool:
        """Whether the loop waits for a condition, and anything may be what it waits for."""
        return self._waits > 0

    def post(self, item: Callable[[], None]) -> None:
        """Have something done soon; safe to call from any thread."""
        self._inbox.put(item)

    def stop(self) -> None:
        """End the loop soon; safe to call from a signal handler and from other threads."""
        self.stopping = True
        self.post(lambda: None)

    def retime(self) -> None:
        """Have the rate of the ticks looked at anew."""
        self._retimed = True

    def attend(self, source: Callable[[], None]) -> None:
        """Call this before every tick and call: it takes in what has come without waking us."""
        self._sources.append(source)

    def catch_up(self) -> None:
        """Take in what has come."""
        for source in self._sources:
            source()

    def ticks(self, hz: float | Callable[[], float]) -> Iterator[float]:
        """Yield monotonic seconds at a rate, serving the inbox in between, until stopped.

        Ticks are counted, not added up, so none is lost to rounding. A callable rate is read
        at every tick and whenever it is to be: a new one counts from the last tick.
        """
        rate_now = hz if callable(hz) else lambda: hz
        rate, start, count = rate_now(), time.monotonic(), 0
        last = start
        while self._serve_until(start + count / rate):
            now = time.monotonic()
            if rate_now() != rate:
                rate, start, count = rate_now(), last, 1
            elif now >= start + count / rate:
                self.catch_up()
                last = now
                yield now
                count += 1
                if time.monotonic() > start + count / rate + _LATE:
                    start, count = time.monotonic(), 1

    def spin(self) -> None:
        """Serve the inbox until stopped."""
        while self._serve_until(math.inf):
            pass

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Serve the inbox until the condition holds; False at the timeout (s) or when stopped."""
        deadline = time.monotonic() + timeout
        # Counted first: what comes between the two would wake nobody and not be seen.
        self._waits += 1
        self.catch_up()
        try:
            while not condition():
                if self.stopping or not self._serve_one(deadline):
                    return False
            return True
        finally:
            self._waits -= 1

    def _serve_until(self, deadline: float) -> bool:
        """Serve the inbox until a time on the monotonic clock; False when stopped.

        Returns early when the rate may have changed. What waits already is served even when the
        time has passed, and no more than that: a loop that is late still answers, and a flood does
        not hold up its ticks.
        """
        for _ in range(self._inbox.qsize()):
            self._inbox.get_nowait()()
        while not self.stopping and not self._retimed and self._serve_one(deadline):
            pass
        self._retimed = False
        return not self.stopping

    def _serve_one(self, deadline: float) -> bool:
        left = deadline - time.monotonic()
        if left <= 0:
            return False
        try:
            # An untimed wait can miss a signal, so even an endless one looks up now and then.
            item = self._inbox.get(timeout=min(left, 0.5))
        except Empty:
            return True
        item()
        return True
