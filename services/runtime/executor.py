"""Event loops: an Executor for one node; several take turns on one thread (greenlets)."""

import os
import sys
import sysconfig
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from heapq import heappop, heappush
from itertools import count
from math import inf
from queue import Empty, SimpleQueue
from types import FrameType
from typing import Any

from quadctl.services.runtime.beat import Beat

Item = Callable[[], None]

LOOK_UP = 0.5
"""Longest wait (s) without a return to Python: an untimed wait can miss a signal."""


class CallbackQueue:
    """Thread-safe queue of an executor that owns its thread."""

    def __init__(self) -> None:
        self._items: SimpleQueue[Item] = SimpleQueue()

    def __len__(self) -> int:
        return self._items.qsize()

    def put(self, item: Item) -> None:
        """Append an item; safe to call from any thread and from a signal handler."""
        self._items.put(item)

    def next(self) -> Item | None:
        """Return the next item, or None if the queue is empty."""
        # Only the loop's thread takes items, and an exception would cost more than the question.
        return self._items.get_nowait() if self._items.qsize() else None

    def wait(self, deadline: float) -> Item | None:
        """Return the next item, or None at the deadline (monotonic s). May wake spuriously."""
        left = deadline - time.monotonic()
        if left <= 0:
            return self.next()
        try:
            return self._items.get(timeout=min(LOOK_UP, left))
        except Empty:
            return None


class Outbox:
    """Work that the loops of a thread put off, in order, until all that are due have run."""

    def __init__(self) -> None:
        self._items: deque[Item] = deque()
        self._flushing = threading.RLock()  # what an item publishes may run a handler that flushes

    def add(self, item: Item) -> None:
        """Append an item; safe to call from any thread."""
        self._items.append(item)

    def flush(self) -> None:
        """Run all items; another thread that flushes waits, so that none overtakes another."""
        # Even if there is none: another thread may be just running the last one.
        with self._flushing:
            while self._items:
                self._items.popleft()()


_BURST = 50
"""Most items that a loop serves before a tick that is due, some 5 ms: a flood must not delay it."""


class Executor:
    """Event loop that serves its queue between ticks, so that a call is answered on arrival.

    Handlers run one at a time, under the lock `_turn`. The loop's thread holds it except while it
    sleeps; a Zenoh thread may then run an inline item itself, which saves waking the loop. Loops
    with the same `origin` (monotonic s) and rate tick together; so their messages travel together.
    """

    def __init__(
        self,
        inbox: CallbackQueue | None = None,
        origin: float | None = None,
        outbox: Outbox | None = None,
        schedule: "_Schedule | None" = None,
        group: int = 0,
    ) -> None:
        self._inbox, self._origin = CallbackQueue() if inbox is None else inbox, origin
        self._outbox, self._schedule = outbox, schedule
        self.group = group
        """Number of the nodes that tick together, of all of the thread."""
        self._ticker: _Ticker | None = None
        self._sources: tuple[Callable[[], None], ...] = ()
        self._retimed = False
        self.waits = 0
        """Number of `wait_for` calls in progress: any item may fulfil their conditions."""
        self._turn = threading.Lock()
        self._turn.acquire()
        self.stopping = False
        self.busy_since = time.monotonic()
        """When the loop last began to do something, monotonic s; 0 while it waits."""
        self.is_ready = False
        """True once its node may be called: before that, nobody waits for an answer."""

    def run_inline(self, item: Item) -> None:
        """Run `item` on this thread if the loop is idle, else enqueue it; what it defers runs at once.

        It must not block: this may be the Zenoh thread that would deliver what it waits for.
        """
        self.join_in(item)
        self.flush()

    def join_in(self, item: Item) -> None:
        """Do the same, but leave what it defers for a flush by the caller."""
        if not self.take_turn():
            self.post(item)
            return
        try:
            item()
        except BaseException as error:  # noqa: BLE001 - raised again where it ends the process
            self.post(partial(_fail, error))
        finally:
            self.end_turn()

    def take_turn(self) -> bool:
        """Let nothing else run until `end_turn`; return False, and do nothing, if the loop is not idle."""
        if not self._turn.acquire(blocking=False):
            return False
        # A loop in `wait_for` must check its condition afterwards.
        if self.waits or len(self._inbox):
            self._turn.release()
            return False
        return True

    def end_turn(self) -> None:
        """End the turn that `take_turn` began."""
        self._turn.release()

    def post(self, item: Item) -> None:
        """Enqueue an item for the loop; safe to call from any thread."""
        self._inbox.put(item)

    def defer(self, item: Item) -> None:
        """Run an item once all loops of this thread that are due have run, or now if it is alone."""
        if self._outbox is None:
            item()
        else:
            self._outbox.add(item)

    def flush(self) -> None:
        """Run now what this thread's loops have deferred."""
        if self._outbox is not None:
            self._outbox.flush()

    def stop(self) -> None:
        """Make the loop end soon; safe to call from a signal handler and from other threads."""
        self.stopping = True
        self.post(lambda: None)

    def retime(self) -> None:
        """Make the loop read its tick rate again."""
        self._retimed = True
        self.post(self._ticker.resume if self._ticker else lambda: None)

    def add_poller(self, source: Callable[[], None]) -> None:
        """Call `source` before every tick and call, to read messages that did not wake the loop."""
        self._sources += (source,)

    def remove_poller(self, source: Callable[[], None]) -> None:
        """Call a poller no more."""
        self._sources = tuple(each for each in self._sources if each != source)

    def poll(self) -> None:
        """Call every poller."""
        for source in self._sources:
            source()

    def ticks(self, hz: float | Callable[[], float]) -> Iterator[float]:
        """Yield monotonic seconds at a rate, which may change, until stopped; serve the queue in between."""
        beat = Beat(hz, self._origin)
        while self._serve_until(beat.due):
            now = time.monotonic()
            if beat.is_due(now):
                self.poll()
                yield now
                beat.passed()

    def every(self, hz: float | Callable[[], float], tick: Callable[[float], None]) -> None:
        """Call `tick` with the monotonic seconds at a rate until stopped, serving the queue in between.

        Among several nodes a tick is an inline item: to resume a loop would cost more than most ticks.
        """
        if self._schedule is None:
            for now in self.ticks(hz):
                tick(now)
        else:
            self._ticker = self._begin_ticks(hz, self._in_turn(tick))
            self.spin()

    def _in_turn(self, tick: Callable[[float], None]) -> Callable[[float], None]:
        def polled(now: float) -> None:
            self.poll()
            tick(now)

        return lambda now: self.join_in(partial(polled, now))

    def every_together(self, hz: Callable[[], float], tick: Callable[[float], None]) -> Item:
        """Call `tick` as `every` does, among several nodes, but in no turn; return a function to read the rate again."""
        return partial(self.post, self._begin_ticks(hz, tick).resume)

    def _begin_ticks(
        self, hz: float | Callable[[], float], tick: Callable[[float], None]
    ) -> "_Ticker":
        assert self._schedule is not None  # noqa: S101 - of several nodes
        ticker = _Ticker(self, Beat(hz, self._origin), tick, self._schedule)
        self._schedule(ticker, ticker.beat.due)
        return ticker

    def spin(self) -> None:
        """Serve the queue until stopped."""
        while self._serve_until(inf):
            pass

    def serve_waiting(self) -> None:
        """Serve the items that are queued now, at most a burst, without waiting for more."""
        self.busy_since = time.monotonic()  # the loop has come round
        for _ in range(min(len(self._inbox), _BURST)):
            if item := self._inbox.next():
                item()

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Serve the queue until the condition holds; False at the timeout (s) or when stopped."""
        deadline = time.monotonic() + timeout
        # Counted before the poll: a message between the two would wake no loop and be missed.
        self.waits += 1
        self.poll()
        try:
            while not condition():
                if self.stopping or not self._serve_one(deadline):
                    return False
            return True
        finally:
            self.waits -= 1

    def _serve_until(self, deadline: float) -> bool:
        """Serve the queue until a time on the monotonic clock; False when stopped.

        Returns early when the rate may have changed. Of the items queued before the call, some are
        served even after that time: a late loop still answers, and a flood delays no tick.
        """
        self.serve_waiting()
        while not self.stopping and not self._retimed and self._serve_one(deadline):
            pass
        self._retimed = False
        return not self.stopping

    def _serve_one(self, deadline: float) -> bool:
        if time.monotonic() >= deadline:
            return False
        self.busy_since = 0.0
        self._turn.release()
        try:
            item = self._inbox.wait(deadline)
        finally:
            self._turn.acquire()
            self.busy_since = time.monotonic()
        if item:
            item()
        return True


def _fail(error: BaseException) -> None:
    raise error


_BLOCKED = 2.0
"""Seconds after which a handler counts as blocked; a supervisor then restarts its process."""
HAS_BLOCKED = "has not returned for"
"""Words about a handler or loop that blocks, by which its line in a log is found."""
_NOT_YET = f"is still running after {_BLOCKED:g} s: the node is not ready yet"
_OURS = os.path.dirname(os.path.dirname(__file__))  # noqa: PTH120 - pathlib is slow
_NOT_THEIRS = tuple({sysconfig.get_path(name) for name in ("stdlib", "platlib", "purelib")})


def _place(frame: FrameType | None) -> str:
    """Return the innermost function outside of Python and of this package, with file and line."""
    innermost = frame
    while frame is not None:
        file = frame.f_code.co_filename
        if not file.startswith(("<", _OURS, *_NOT_THEIRS)):
            break
        frame = frame.f_back
    frame = frame or innermost
    if frame is None:
        return "the loop"
    code = frame.f_code
    return f"{code.co_name} ({os.path.basename(code.co_filename)}, line {frame.f_lineno})"  # noqa: PTH119


_TOGETHER = 128
"""Nodes that tick together at most: what comes meanwhile waits for all of them."""
_APART, _SLOT = 1 / 160, 1 / 20
"""Time (s) between the ticks of groups, eight in 50 ms; and between those of nodes that tick once a second."""


class MultiNodeExecutor:
    """Executor of several nodes on one thread; when one returns or raises, all are stopped.

    Each node is a greenlet that resumes where it waited. Threads would wait for the interpreter's
    lock at every turn, which costs more than their work. A `single` node needs no greenlet.
    """

    def __init__(self, *, single: bool) -> None:
        self._single = single
        self._runs: list[tuple[Executor, Callable[[], None]]] = []
        self._queues: list[_GreenletQueue] = []
        self._errors: list[BaseException] = []
        self._runnable: SimpleQueue[_GreenletQueue] = SimpleQueue()
        self._timers: list[tuple[float, int, _Timed]] = []
        self._numbers = count()
        self._origin = round(time.monotonic(), 6)
        self.outbox = Outbox()

    def new_executor(self) -> Executor:
        """Return the event loop for one node."""
        if self._single:
            return Executor()
        queue = _GreenletQueue(self._runnable.put, self._sleep)
        group = len(self._queues) // _TOGETHER
        origin = self._origin + group * _APART - len(self._queues) * _SLOT
        self._queues.append(queue)
        return Executor(queue, origin, self.outbox, self._at, group)

    def add_node(self, loop: Executor, run: Callable[[], None]) -> None:
        """Add a node; `run` must return when its loop is stopped."""
        self._runs.append((loop, run))

    def stop(self) -> None:
        """Make all nodes end soon; safe to call from a signal handler."""
        for loop, _ in self._runs:
            loop.stop()

    def run(self) -> None:
        """Run all nodes until they have ended; raise the first error of one."""
        if self._single:
            self._runs[0][1]()
            return
        from greenlet import greenlet

        for queue, (_, run) in zip(self._queues, self._runs, strict=True):
            queue.task = greenlet(lambda run=run: self._run_node(run))
        for queue in self._queues:
            queue.task.switch()
        self.outbox.flush()
        while not all(queue.task.dead for queue in self._queues):
            self._take_turns()
            self.outbox.flush()
        if self._errors:
            raise self._errors[0]

    def watch(self, warn: Callable[[str], None]) -> None:
        """Call `warn` with the place of a handler or loop that has not returned for 2 s, once each."""
        thread = threading.get_ident()
        threading.Thread(target=self._watch, args=(thread, warn), daemon=True).start()

    def _watch(self, thread: int, warn: Callable[[str], None]) -> None:
        named = 0.0
        while True:
            time.sleep(LOOK_UP)
            for loop, _ in self._runs:
                since = loop.busy_since
                if since and since != named and time.monotonic() > since + _BLOCKED:
                    named = since
                    place = _place(sys._current_frames().get(thread))  # noqa: SLF001 - the only way
                    blocks = f"{HAS_BLOCKED} {_BLOCKED:g} s: nothing else is answered"
                    warn(f"{place} {blocks if loop.is_ready else _NOT_YET}")

    def _run_node(self, run: Callable[[], None]) -> None:
        try:
            run()
        except BaseException as error:  # noqa: BLE001 - raised again when all have ended
            self._errors.append(error)
        finally:
            self.stop()

    def _take_turns(self) -> None:
        """Wait for the next runnable node, then resume every node whose timer has expired."""
        left = (self._timers[0][0] if self._timers else inf) - time.monotonic()
        try:
            queue = self._runnable.get(timeout=max(min(left, LOOK_UP), 0))
        except Empty:
            pass
        else:
            queue.resume()
            for _ in range(self._runnable.qsize()):  # else each would wait for the ticks of all
                self._runnable.get().resume()
        now = time.monotonic()
        while self._timers and self._timers[0][0] <= now:
            _, number, timed = heappop(self._timers)
            # One that was resumed before its time has another timer by now, or none.
            if timed.timer == number:
                timed.resume()

    def _at(self, timed: "_Timed", deadline: float) -> None:
        """Resume a node or a ticker at a time (monotonic s), not before."""
        timed.timer = next(self._numbers)
        if deadline < inf:
            heappush(self._timers, (deadline, timed.timer, timed))

    def _sleep(self, queue: "_GreenletQueue", deadline: float) -> None:
        self._at(queue, deadline)
        queue.task.parent.switch()


class _Ticker:
    """Ticks of a loop beside others."""

    def __init__(
        self, loop: Executor, beat: Beat, tick: Callable[[float], None], schedule: "_Schedule"
    ) -> None:
        self.timer = -1  # the number of its last timer
        self.beat = beat
        self._loop, self._tick, self._schedule = loop, tick, schedule

    def resume(self) -> None:
        """Run the tick if it is due, and wait for the next one."""
        if self._loop.stopping:
            return
        now = time.monotonic()
        if self.beat.is_due(now):
            self._tick(now)
            self.beat.passed()
        self._schedule(self, self.beat.due)


class _GreenletQueue(CallbackQueue):
    """Queue of a loop that sleeps while other loops run on its thread."""

    def __init__(
        self,
        wake: Callable[["_GreenletQueue"], None],
        sleep: Callable[["_GreenletQueue", float], None],
    ) -> None:
        super().__init__()
        self.task: Any = None  # a greenlet
        self.timer = -1  # the number of its last timer
        self._wake, self._sleep, self._is_runnable = wake, sleep, False

    def put(self, item: Item) -> None:
        super().put(item)
        self._make_runnable()

    def wait(self, deadline: float) -> Item | None:
        """Wait like CallbackQueue.wait, but let the other nodes run first in any case."""
        if len(self):
            self._make_runnable()
        self._sleep(self, deadline)
        return self.next()

    def resume(self) -> None:
        self._is_runnable = False
        if not self.task.dead:
            self.task.switch()

    def _make_runnable(self) -> None:
        # Once is enough: the resumed loop finds all later items in the queue.
        if not self._is_runnable:
            self._is_runnable = True
            self._wake(self)


_Timed = _GreenletQueue | _Ticker
_Schedule = Callable[[_Timed, float], None]
