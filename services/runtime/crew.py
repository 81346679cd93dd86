"""The services of one process, one a vehicle: each has a loop of its own."""

import time
from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from math import inf
from queue import Empty, SimpleQueue
from typing import Any

from services.runtime.inbox import LOOK_UP, Inbox, Item
from services.runtime.loop import Loop


class Crew:
    """They live and die together: when one ends, by itself or by an error, all do.

    Several take turns on one thread, each a greenlet that goes on where it waited. A thread for
    each would have them wait for the interpreter's lock at every turn, which costs more than what
    they do in it.
    """

    def __init__(self, *, alone: bool) -> None:
        """Of one service `alone`, which has the thread for itself, or of several."""
        self._alone = alone
        self._runs: list[tuple[Loop, Callable[[], None]]] = []
        self._berths: list[_Berth] = []
        self._errors: list[BaseException] = []
        self._roused: SimpleQueue[_Berth] = SimpleQueue()
        self._alarms: list[tuple[float, int, _Berth]] = []
        self._numbers = count()
        self._origin = time.monotonic()

    def loop(self) -> Loop:
        """A loop for one of them."""
        if self._alone:
            return Loop()
        berth = _Berth(self._roused.put, self._sleep)
        self._berths.append(berth)
        return Loop(berth, self._origin)

    def take(self, loop: Loop, run: Callable[[], None]) -> None:
        """Add one; `run` is to return when its loop is stopped."""
        self._runs.append((loop, run))

    def stop(self) -> None:
        """Have all of them end soon; safe to call from a signal handler."""
        for loop, _ in self._runs:
            loop.stop()

    def run(self) -> None:
        """Run all until they have ended; raises what one of them raised."""
        if self._alone:
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

    def _sleep(self, berth: "_Berth", deadline: float) -> None:
        berth.alarm = next(self._numbers)
        if deadline < inf:
            heappush(self._alarms, (deadline, berth.alarm, berth))
        berth.task.parent.switch()


class _Berth(Inbox):
    """The inbox of a loop that sleeps while others on its thread have their turns."""

    def __init__(
        self, rouse: Callable[["_Berth"], None], sleep: Callable[["_Berth", float], None]
    ) -> None:
        super().__init__()
        self.task: Any = None
        """Its greenlet."""
        self.alarm = -1
        """The number of the alarm that it has set."""
        self._rouse, self._sleep, self._is_roused = rouse, sleep, False

    def put(self, item: Item) -> None:
        """As Inbox.put."""
        super().put(item)
        self._be_roused()

    def wait(self, deadline: float) -> Item | None:
        """As Inbox.wait; what is there already comes after the others' turns."""
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
