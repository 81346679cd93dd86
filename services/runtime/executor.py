"""Event loops: an Executor for one node, or several that take turns on one thread (greenlets)."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from heapq import heappop, heappush
from itertools import count
from math import inf
from queue import Empty, SimpleQueue
from typing import Any

Item = Callable[[], None]

LOOK_UP = 0.5
"""An untimed wait can miss a signal, so even an endless one looks up now and then, s."""


class CallbackQueue:
    """That of a loop which has its thread for itself."""

    def __init__(self) -> None:
        self._items: SimpleQueue[Item] = SimpleQueue()

    def __len__(self) -> int:
        return self._items.qsize()

    def put(self, item: Item) -> None:
        """Post something; safe to call from any thread and from a signal handler."""
        self._items.put(item)

    def next(self) -> Item | None:
        """What waits, without waiting for it; None where nothing does."""
        try:
            return self._items.get_nowait()
        except Empty:
            return None

    def wait(self, deadline: float) -> Item | None:
        """What comes until then (monotonic s); None where nothing does, or for no reason at all."""
        left = deadline - time.monotonic()
        if left <= 0:
            return self.next()
        try:
            return self._items.get(timeout=min(LOOK_UP, left))
        except Empty:
            return None


_LATE = 0.1
"""A loop that is later than this (s) drops the ticks it missed instead of hurrying after them."""


class Executor:
    """Serves an inbox between ticks, so that a call is answered on arrival.

    A handler never runs beside another: it has the turn. The loop's own thread has it unless it
    sleeps; then one of Zenoh's may take it for what is done at once, which saves waking the loop.
    """

    def __init__(self, inbox: CallbackQueue | None = None, origin: float | None = None) -> None:
        """With an inbox of its own, or this one.

        Loops with the same `origin` (monotonic s) tick together where their rates are equal: what
        they send then travels together.
        """
        self._inbox, self._origin = CallbackQueue() if inbox is None else inbox, origin
        self._sources: list[Callable[[], None]] = []
        self._retimed = False
        self.waits = 0
        """Waits for a condition under way; while there are any, anything may be what is waited for."""
        self._turn = threading.Lock()
        self._turn.acquire()
        self.stopping = False

    def run_inline(self, item: Item) -> None:
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

    def add_poller(self, source: Callable[[], None]) -> None:
        """Call this before every tick and call: it takes in what has come without waking us."""
        self._sources.append(source)

    def poll(self) -> None:
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
                self.poll()
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
        self.poll()
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


class MultiNodeExecutor:
    """They live and die together: when one ends, by itself or by an error, all do.

    Several take turns on one thread, each a greenlet that goes on where it waited. A thread for
    each would have them wait for the interpreter's lock at every turn, which costs more than what
    they do in it.
    """

    def __init__(self, *, single: bool) -> None:
        """Of a `single` service, which has the thread for itself, or of several."""
        self._single = single
        self._runs: list[tuple[Executor, Callable[[], None]]] = []
        self._berths: list[_GreenletQueue] = []
        self._errors: list[BaseException] = []
        self._roused: SimpleQueue[_GreenletQueue] = SimpleQueue()
        self._alarms: list[tuple[float, int, _GreenletQueue]] = []
        self._numbers = count()
        self._origin = time.monotonic()

    def new_executor(self) -> Executor:
        """A loop for one of them."""
        if self._single:
            return Executor()
        berth = _GreenletQueue(self._roused.put, self._sleep)
        self._berths.append(berth)
        return Executor(berth, self._origin)

    def add_node(self, loop: Executor, run: Callable[[], None]) -> None:
        """Add one; `run` is to return when its loop is stopped."""
        self._runs.append((loop, run))

    def stop(self) -> None:
        """Have all of them end soon; safe to call from a signal handler."""
        for loop, _ in self._runs:
            loop.stop()

    def run(self) -> None:
        """Run all until they have ended; raises what one of them raised."""
        if self._single:
            self._runs[0][1]()
            return
        from greenlet import greenlet

        for berth, (_, run) in zip(self._berths, self._runs, strict=True):
            berth.task = greenlet(lambda run=run: self._live(run))
        for berth in self._berths:
            berth.task.switch()
        while not all(berth.task.dead for berth in self._berths):
            self._take_turns()
        if self._errors:
            raise self._errors[0]

    def _live(self, run: Callable[[], None]) -> None:
        try:
            run()
        except BaseException as error:  # noqa: BLE001 - raised again where all have ended
            self._errors.append(error)
        finally:
            self.stop()

    def _take_turns(self) -> None:
        """Wait for the next who has something to do, then let all go on whose time has come."""
        left = (self._alarms[0][0] if self._alarms else inf) - time.monotonic()
        try:
            roused = self._roused.get(timeout=max(min(left, LOOK_UP), 0))
        except Empty:
            pass
        else:
            roused.go_on()
        now = time.monotonic()
        while self._alarms and self._alarms[0][0] <= now:
            _, number, berth = heappop(self._alarms)
            # One that went on before its time has another alarm by now, or none.
            if berth.alarm == number:
                berth.go_on()

    def _sleep(self, berth: "_GreenletQueue", deadline: float) -> None:
        berth.alarm = next(self._numbers)
        if deadline < inf:
            heappush(self._alarms, (deadline, berth.alarm, berth))
        berth.task.parent.switch()


class _GreenletQueue(CallbackQueue):
    """The inbox of a loop that sleeps while others on its thread have their turns."""

    def __init__(
        self,
        rouse: Callable[["_GreenletQueue"], None],
        sleep: Callable[["_GreenletQueue", float], None],
    ) -> None:
        super().__init__()
        self.task: Any = None
        """Its greenlet."""
        self.alarm = -1
        """The number of the alarm that it has set."""
        self._rouse, self._sleep, self._is_roused = rouse, sleep, False

    def put(self, item: Item) -> None:
        """As CallbackQueue.put."""
        super().put(item)
        self._be_roused()

    def wait(self, deadline: float) -> Item | None:
        """As CallbackQueue.wait; what is there already comes after the others' turns."""
        if len(self):
            self._be_roused()
        self._sleep(self, deadline)
        return self.next()

    def go_on(self) -> None:
        """Let it go on where it waited, until it waits again or ends."""
        self._is_roused = False
        if not self.task.dead:
            self.task.switch()

    def _be_roused(self) -> None:
        # Said once; what is posted after that it finds where it looks.
        if not self._is_roused:
            self._is_roused = True
            self._rouse(self)
