"""A service's loop: who has its turn alone touches the service's state; others reach its inbox."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial

from services.runtime.inbox import Inbox, Item

_LATE = 0.1
"""A loop that is later than this (s) drops the ticks it missed instead of hurrying after them."""


class Loop:
    """Serves an inbox between ticks, so that a call is answered on arrival.

    A handler never runs beside another: it has the turn. The loop's own thread has it unless it
    sleeps; then one of Zenoh's may take it for what is done at once, which saves waking the loop.
    """

    def __init__(self, inbox: Inbox | None = None, origin: float | None = None) -> None:
        """With an inbox of its own, or this one.

        Loops with the same `origin` (monotonic s) tick together where their rates are equal: what
        they send then travels together.
        """
        self._inbox, self._origin = Inbox() if inbox is None else inbox, origin
        self._sources: list[Callable[[], None]] = []
        self._retimed = False
        self.waits = 0
        """Waits for a condition under way; while there are any, anything may be what is waited for."""
        self._turn = threading.Lock()
        self._turn.acquire()
        self.stopping = False

    def at_once(self, item: Item) -> None:
        """Have something done on this thread while the loop sleeps, else soon, in its order.

        It must not wait for anything: this may be the thread by which that would come.
        """
        if not self._turn.acquire(blocking=False):
            self.post(item)
            return
        try:
            # A loop that waits for a condition has to look at it afterwards.
            if self.waits or len(self._inbox):
                self.post(item)
            else:
                item()
        except BaseException as error:  # noqa: BLE001 - raised again where it ends the process
            self.post(partial(_fail, error))
        finally:
            self._turn.release()

    def post(self, item: Item) -> None:
        """Have something done soon; safe to call from any thread."""
        self._inbox.put(item)

    def stop(self) -> None:
        """End the loop soon; safe to call from a signal handler and from other threads."""
        self.stopping = True
        self.post(lambda: None)

    def retime(self) -> None:
        """Have the rate of the ticks looked at anew."""
        self._retimed = True
        self.post(lambda: None)

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
        rate, count = rate_now(), 0
        last = start = self._beat(rate)
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
                    start, count = self._beat(rate), 1

    def spin(self) -> None:
        """Serve the inbox until stopped."""
        while self._serve_until(math.inf):
            pass

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Serve the inbox until the condition holds; False at the timeout (s) or when stopped."""
        deadline = time.monotonic() + timeout
        # Counted first: what comes between the two would wake nobody and not be seen.
        self.waits += 1
        self.catch_up()
        try:
            while not condition():
                if self.stopping or not self._serve_one(deadline):
                    return False
            return True
        finally:
            self.waits -= 1

    def _beat(self, rate: float) -> float:
        """From when on ticks are counted: from now, or from the last one of all with this origin."""
        now = time.monotonic()
        if self._origin is None or rate == math.inf:
            return now
        return self._origin + math.floor((now - self._origin) * rate) / rate

    def _serve_until(self, deadline: float) -> bool:
        """Serve the inbox until a time on the monotonic clock; False when stopped.

        Returns early when the rate may have changed. What waits already is served even when the
        time has passed, and no more than that: a loop that is late still answers, and a flood does
        not hold up its ticks.
        """
        for _ in range(len(self._inbox)):
            if item := self._inbox.next():
                item()
        while not self.stopping and not self._retimed and self._serve_one(deadline):
            pass
        self._retimed = False
        return not self.stopping

    def _serve_one(self, deadline: float) -> bool:
        if time.monotonic() >= deadline:
            return False
        self._turn.release()
        try:
            item = self._inbox.wait(deadline)
        finally:
            self._turn.acquire()
        if item:
            item()
        return True


def _fail(error: BaseException) -> None:
    raise error
