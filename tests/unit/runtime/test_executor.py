"""Whose turn it is: a loop's own thread, or another's while the loop sleeps."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import Any

import pytest

from quadctl.services.runtime.executor import CallbackQueue, Executor, Item, MultiNodeExecutor


class Few:
    """A crew of several whose services are written down as functions of their loop."""

    def __init__(self, *runs: Callable[[Executor], None]) -> None:
        self.crew = MultiNodeExecutor(single=False)
        self.loops = [self.crew.new_executor() for _ in runs]
        for loop, run in zip(self.loops, runs, strict=True):
            self.crew.add_node(loop, partial(run, loop))


@pytest.fixture
def later() -> Iterator[Callable[[Callable[[], None]], None]]:
    """Has something done on another thread in a moment."""
    timers: list[threading.Timer] = []

    def do(what: Callable[[], None]) -> None:
        timers.append(threading.Timer(0.05, what))
        timers[-1].start()

    yield do
    for timer in timers:
        timer.join()


def test_each_ticks_at_its_own_rate_whatever_the_others_do():
    ticks = [0, 0]

    def ticking(number: int, hz: float) -> Callable[[Executor], None]:
        def run(loop: Executor) -> None:
            for _ in loop.ticks(hz):
                ticks[number] += 1
                if min(ticks) > 2:
                    return

        return run

    Few(ticking(0, 1000), ticking(1, 20)).crew.run()
    assert ticks[0] > ticks[1]


def test_what_is_posted_is_done_in_the_turn_of_its_own_loop(later):
    done: list[str] = []

    def waits(loop: Executor) -> None:
        assert loop.wait_for(lambda: len(done) == 2, 5.0)

    def spins(loop: Executor) -> None:
        loop.spin()

    few = Few(waits, spins)
    first = few.loops[0]
    later(lambda: [first.post(partial(done.append, name)) for name in "ab"])
    few.crew.run()
    assert done == ["a", "b"]
    assert few.loops[1].stopping, "one has ended, so all do"


def test_a_flood_for_one_holds_up_nobody_else():
    ticks: list[float] = []

    def flooded(loop: Executor) -> None:
        def again() -> None:
            time.sleep(0.0005)
            loop.post(again)

        loop.post(again)
        loop.spin()

    def ticking(loop: Executor) -> None:
        for now in loop.ticks(100):
            ticks.append(now)
            if len(ticks) == 30:
                return

    Few(flooded, ticking).crew.run()
    assert len(ticks) == 30


def test_one_that_waits_within_a_call_lets_the_others_go_on():
    order: list[str] = []

    def asks(loop: Executor) -> None:
        def call() -> None:
            order.append("asked")
            loop.wait_for(lambda: "answered" in order, 5.0)
            order.append("told")

        loop.post(call)
        loop.wait_for(lambda: "told" in order, 5.0)

    def answers(loop: Executor) -> None:
        loop.wait_for(lambda: "asked" in order, 5.0)
        order.append("answered")
        few.loops[0].post(lambda: None)
        loop.spin()

    few = Few(asks, answers)
    few.crew.run()
    assert order == ["asked", "answered", "told"]


def test_an_error_of_one_ends_all_and_is_raised():
    ended: list[str] = []

    def fails(loop: Executor) -> None:
        loop.wait_for(lambda: False, 0.05)
        raise ValueError("broken")

    def spins(loop: Executor) -> None:
        loop.spin()
        ended.append("other")

    with pytest.raises(ValueError, match="broken"):
        Few(spins, fails).crew.run()
    assert ended == ["other"]


def test_stopped_from_another_thread_all_end(later):
    few = Few(*[lambda loop: loop.spin()] * 3)
    later(few.crew.stop)
    few.crew.run()
    assert all(loop.stopping for loop in few.loops)


def test_one_alone_has_the_thread_for_itself():
    crew, ran = MultiNodeExecutor(single=True), list[str]()
    loop = crew.new_executor()
    crew.add_node(loop, lambda: ran.append(threading.current_thread().name))
    crew.run()
    assert ran == [threading.main_thread().name]


SOON = 10.0


class Asleep:
    """A loop whose thread has nothing to do."""

    def __init__(self) -> None:
        self.loop = Executor()
        self.raised: list[ValueError] = []
        self.thread = threading.Thread(target=self._run)
        self.thread.start()
        self.settle()

    def _run(self) -> None:
        try:
            self.loop.spin()
        except ValueError as error:
            self.raised.append(error)

    def settle(self) -> None:
        """Returns when all that was posted is done, and the loop is asleep."""
        done = threading.Event()
        self.loop.post(done.set)
        assert done.wait(SOON)
        asleep = threading.Event()
        while not asleep.is_set():
            self.loop.run_inline(asleep.set)

    def does(self, item: Callable[[Callable[[], None]], None]) -> int:
        """On which thread something is done that is handed to the loop so."""
        threads, done = list[int](), threading.Event()

        def note() -> None:
            threads.append(threading.get_ident())
            done.set()

        item(note)
        assert done.wait(SOON)
        return threads[0]


@pytest.fixture
def asleep() -> Iterator[Asleep]:
    made = Asleep()
    yield made
    made.loop.stop()
    made.thread.join(SOON)
    assert not made.thread.is_alive()


def test_what_is_posted_is_done_by_the_loops_thread(asleep: Asleep):
    assert asleep.does(asleep.loop.post) == asleep.thread.ident


def test_inline_work_of_a_sleeping_loop_runs_on_callers_thread(asleep: Asleep):
    assert asleep.does(asleep.loop.run_inline) == threading.get_ident()


def test_beside_a_handler_nothing_is_done_at_once(asleep: Asleep):
    busy, end = threading.Event(), threading.Event()

    def handler() -> None:
        busy.set()
        assert end.wait(SOON)

    asleep.loop.post(handler)
    assert busy.wait(SOON)
    done = list[int]()
    asleep.loop.run_inline(lambda: done.append(1))
    assert done == []
    asleep.loop.run_inline(lambda: done.append(2))
    end.set()
    asleep.settle()
    assert done == [1, 2]


def test_before_its_first_sleep_a_loop_has_the_turn():
    loop, done = Executor(), list[int]()
    loop.run_inline(lambda: done.append(1))
    assert done == []
    loop.post(loop.stop)
    loop.spin()
    assert done == [1]


def test_loop_waiting_for_a_condition_sees_inline_work_at_once(asleep: Asleep):
    brought, seen = list[int](), list[Any]()
    asleep.loop.post(lambda: seen.append(asleep.loop.wait_for(lambda: bool(brought), SOON)))
    while not asleep.loop.waits:
        pass
    asleep.loop.run_inline(lambda: brought.append(1))
    asleep.settle()
    assert seen == [True]


def test_failing_inline_work_ends_the_loop_like_posted_work():
    made = Asleep()

    def fail() -> None:
        raise ValueError("wrong")

    made.loop.run_inline(fail)
    made.thread.join(SOON)
    assert [str(error) for error in made.raised] == ["wrong"]


class Still(CallbackQueue):
    """Nothing ever comes; a clock that shows each time that is waited for."""

    now = 103.017

    def wait(self, deadline: float) -> Item | None:
        self.now = deadline
        return None


@pytest.mark.parametrize(("origin", "first"), [(None, 103.017), (100.0, 103.0), (100.01, 103.01)])
def test_loops_of_one_origin_tick_together(monkeypatch, origin: float | None, first: float):
    inbox = Still()
    monkeypatch.setattr(time, "monotonic", lambda: inbox.now)
    ticks = list(islice(Executor(inbox, origin).ticks(50.0), 4))
    assert ticks == pytest.approx([103.017, first + 0.02, first + 0.04, first + 0.06])


def test_ticks_without_pause_have_no_beat(monkeypatch):
    inbox = Still()
    monkeypatch.setattr(time, "monotonic", lambda: inbox.now)
    assert list(islice(Executor(inbox, 100.0).ticks(math.inf), 3)) == [103.017] * 3
