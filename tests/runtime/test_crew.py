"""Several services of one process take turns, and wait as if each had the thread for itself."""

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial

import pytest

from quadctl.services.runtime.executor import Executor, MultiNodeExecutor


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
