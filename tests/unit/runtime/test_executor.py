"""Executors of one or several nodes, and inline work on a caller's thread."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import Any

import pytest

from quadctl.services.runtime import executor
from quadctl.services.runtime.executor import (
    CallbackQueue,
    Executor,
    Item,
    MultiNodeExecutor,
    Outbox,
)
from tests.support.running import eventually


class Nodes:
    """Multi-node executor whose nodes are functions of their executor."""

    def __init__(self, *runs: Callable[[Executor], None]) -> None:
        self.executor = MultiNodeExecutor(single=False)
        self.executors = [self.executor.new_executor() for _ in runs]
        for loop, run in zip(self.executors, runs, strict=True):
            self.executor.add_node(loop, partial(run, loop))


@pytest.fixture
def later() -> Iterator[Callable[[Callable[[], None]], None]]:
    """Yield a function that runs a callable on another thread after a moment."""
    timers: list[threading.Timer] = []

    def do(what: Callable[[], None]) -> None:
        timers.append(threading.Timer(0.05, what))
        timers[-1].start()

    yield do
    for timer in timers:
        timer.join()


def test_each_executor_ticks_at_its_own_rate():
    ticks = [0, 0]

    def ticking(number: int, hz: float) -> Callable[[Executor], None]:
        def run(loop: Executor) -> None:
            for _ in loop.ticks(hz):
                ticks[number] += 1
                if min(ticks) > 2:
                    return

        return run

    Nodes(ticking(0, 1000), ticking(1, 20)).executor.run()
    assert ticks[0] > ticks[1]


def test_posted_work_runs_in_its_own_executor(later):
    done: list[str] = []

    def waits(loop: Executor) -> None:
        assert loop.wait_for(lambda: len(done) == 2, 5.0)

    def spins(loop: Executor) -> None:
        loop.spin()

    nodes = Nodes(waits, spins)
    first = nodes.executors[0]
    later(lambda: [first.post(partial(done.append, name)) for name in "ab"])
    nodes.executor.run()
    assert done == ["a", "b"]
    assert nodes.executors[1].stopping, "when one node ends, all do"


def test_a_flood_of_one_executor_delays_no_other():
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

    Nodes(flooded, ticking).executor.run()
    assert len(ticks) == 30


@pytest.mark.thorough
def test_an_executor_that_waits_in_a_callback_lets_others_run():
    order: list[str] = []

    def asks(loop: Executor) -> None:
        def call() -> None:
            order.append("asked")
            loop.wait_for(lambda: "answered" in order, 5.0)
            order.append("received")

        loop.post(call)
        loop.wait_for(lambda: "received" in order, 5.0)

    def answers(loop: Executor) -> None:
        loop.wait_for(lambda: "asked" in order, 5.0)
        order.append("answered")
        nodes.executors[0].post(lambda: None)
        loop.spin()

    nodes = Nodes(asks, answers)
    nodes.executor.run()
    assert order == ["asked", "answered", "received"]


def test_an_error_of_one_executor_ends_all_and_is_raised():
    ended: list[str] = []

    def fails(loop: Executor) -> None:
        loop.wait_for(lambda: False, 0.05)
        raise ValueError("broken")

    def spins(loop: Executor) -> None:
        loop.spin()
        ended.append("other")

    with pytest.raises(ValueError, match="broken"):
        Nodes(spins, fails).executor.run()
    assert ended == ["other"]


def test_a_stop_from_another_thread_ends_all_executors(later):
    nodes = Nodes(*[lambda loop: loop.spin()] * 3)
    later(nodes.executor.stop)
    nodes.executor.run()
    assert all(loop.stopping for loop in nodes.executors)


@pytest.mark.thorough
def test_deferred_work_runs_once_all_due_nodes_have_run():
    done: list[str] = []

    def run(loop: Executor) -> None:
        for _ in islice(loop.ticks(20), 2):
            done.append("ran")
            loop.defer(lambda: done.append("deferred"))
        loop.wait_for(lambda: done.count("deferred") == 6, 5.0)

    Nodes(run, run, run).executor.run()
    assert done.count("deferred") == 6
    # The nodes' first ticks may be a beat apart from the start; the second ones are together.
    assert done[-6:] == ["ran"] * 3 + ["deferred"] * 3


def test_deferred_work_runs_in_order_when_a_node_flushes_it():
    done: list[int] = []

    def run(loop: Executor) -> None:
        for number in (1, 2, 3):
            loop.defer(partial(done.append, number))
        assert done == []
        loop.flush()
        assert done == [1, 2, 3]

    Nodes(run).executor.run()
    assert done == [1, 2, 3]


def test_a_flush_waits_for_the_work_that_another_thread_has_begun():
    outbox, begun, may_end = Outbox(), threading.Event(), threading.Event()
    done: list[str] = []

    def publish() -> None:
        begun.set()
        may_end.wait(5.0)
        done.append("published")

    def reply() -> None:
        outbox.flush()
        done.append("replied")

    outbox.add(publish)
    threads = [threading.Thread(target=outbox.flush), threading.Thread(target=reply)]
    threads[0].start()
    begun.wait(5.0)
    threads[1].start()
    threads[1].join(0.05)  # by then a reply that overtakes has been given
    may_end.set()
    for thread in threads:
        thread.join(5.0)
    assert done == ["published", "replied"]


@pytest.mark.timeout(30)
def test_an_item_may_flush_itself():
    outbox, done = Outbox(), list[str]()

    def publish() -> None:
        done.append("published")
        outbox.flush()

    outbox.add(publish)
    outbox.add(lambda: done.append("next"))
    outbox.flush()
    assert done == ["published", "next"]


def test_a_single_node_defers_nothing():
    done: list[str] = []
    MultiNodeExecutor(single=True).new_executor().defer(lambda: done.append("now"))
    assert done == ["now"]


def test_a_single_node_runs_on_the_main_thread():
    executor, ran = MultiNodeExecutor(single=True), list[str]()
    loop = executor.new_executor()
    executor.add_node(loop, lambda: ran.append(threading.current_thread().name))
    executor.run()
    assert ran == [threading.main_thread().name]


SOON = 10.0


class SleepingExecutor:
    """Executor with its own thread, idle."""

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
        """Wait until all posted work is done and the executor is asleep."""
        done = threading.Event()
        self.loop.post(done.set)
        assert done.wait(SOON)
        asleep = threading.Event()
        while not asleep.is_set():
            self.loop.run_inline(asleep.set)

    def thread_of(self, item: Callable[[Callable[[], None]], None]) -> int:
        """Return the thread on which the executor runs work submitted by `item`."""
        threads, done = list[int](), threading.Event()

        def note() -> None:
            threads.append(threading.get_ident())
            done.set()

        item(note)
        assert done.wait(SOON)
        return threads[0]


@pytest.fixture
def asleep() -> Iterator[SleepingExecutor]:
    made = SleepingExecutor()
    yield made
    made.loop.stop()
    made.thread.join(SOON)
    assert not made.thread.is_alive()


def test_posted_work_runs_on_the_executors_thread(asleep: SleepingExecutor):
    assert asleep.thread_of(asleep.loop.post) == asleep.thread.ident


def test_inline_work_of_a_sleeping_executor_runs_on_the_caller(asleep: SleepingExecutor):
    assert asleep.thread_of(asleep.loop.run_inline) == threading.get_ident()


def test_inline_work_waits_for_a_running_callback(asleep: SleepingExecutor):
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


def test_a_loop_counts_as_blocked_only_when_its_node_may_be_called(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(executor, "_BLOCKED", 0.05)
    monkeypatch.setattr(executor, "LOOK_UP", 0.01)
    both, warnings = MultiNodeExecutor(single=True), list[str]()
    loop = both.new_executor()

    def run() -> None:
        eventually(lambda: len(warnings) == 1)
        loop.is_ready = True
        loop.serve_waiting()
        eventually(lambda: len(warnings) == 2)

    both.add_node(loop, run)
    both.watch(warnings.append)
    both.run()
    assert [executor.HAS_BLOCKED in warning for warning in warnings] == [False, True]
    assert "the node is not ready yet" in warnings[0]


def test_before_the_first_sleep_inline_work_is_queued():
    loop, done = Executor(), list[int]()
    loop.run_inline(lambda: done.append(1))
    assert done == []
    loop.post(loop.stop)
    loop.spin()
    assert done == [1]


def test_a_waiting_executor_sees_inline_work_at_once(asleep: SleepingExecutor):
    brought, seen = list[int](), list[Any]()
    asleep.loop.post(lambda: seen.append(asleep.loop.wait_for(lambda: bool(brought), SOON)))
    while not asleep.loop.waits:
        pass
    asleep.loop.run_inline(lambda: brought.append(1))
    asleep.settle()
    assert seen == [True]


def test_failing_inline_work_ends_the_executor_like_posted_work():
    made = SleepingExecutor()

    def fail() -> None:
        raise ValueError("wrong")

    made.loop.run_inline(fail)
    made.thread.join(SOON)
    assert [str(error) for error in made.raised] == ["wrong"]


class EmptyQueue(CallbackQueue):
    """Queue without items; its clock jumps to each deadline."""

    now = 103.017

    def wait(self, deadline: float) -> Item | None:
        self.now = deadline
        return None


@pytest.mark.parametrize(("origin", "first"), [(None, 103.017), (100.0, 103.0), (100.01, 103.01)])
def test_executors_with_one_origin_tick_together(monkeypatch, origin: float | None, first: float):
    queue = EmptyQueue()
    monkeypatch.setattr(time, "monotonic", lambda: queue.now)
    ticks = list(islice(Executor(queue, origin).ticks(50.0), 4))
    assert ticks == pytest.approx([103.017, first + 0.02, first + 0.04, first + 0.06])


def test_ticks_at_an_infinite_rate_do_not_wait(monkeypatch):
    queue = EmptyQueue()
    monkeypatch.setattr(time, "monotonic", lambda: queue.now)
    assert list(islice(Executor(queue, 100.0).ticks(math.inf), 3)) == [103.017] * 3
