"""Held calls: each is settled once, at its time and in order, or told why not."""

from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadctl.services.runtime import server
from quadctl.services.runtime.errors import Expired, NotReady, QuadctlError, Refused
from quadctl.services.runtime.server import Schedule, ScheduledCall

NEVER = 1e12


class Outcome(NamedTuple):
    name: int
    boot: str
    stamp: float
    problem: QuadctlError | None


class Clock:
    """A schedule, the clock that it is told of, and what became of the calls."""

    def __init__(self) -> None:
        self.schedule = Schedule()
        self.boot, self.stamp = "", 0.0
        self.outcomes: list[Outcome] = []

    def to(self, boot: str, stamp: float, now: float = 0.0) -> None:
        self.boot, self.stamp = boot, stamp
        self.schedule.advance(boot, stamp, now)

    def hold(self, name: int, boot: str, at: float, deadline: float = NEVER) -> None:
        def settle(problem: QuadctlError | None) -> None:
            self.outcomes.append(Outcome(name, self.boot, self.stamp, problem))

        self.schedule.schedule(ScheduledCall(boot, at, deadline, settle))

    @property
    def executed(self) -> list[tuple[int, float]]:
        return [(o.name, o.stamp) for o in self.outcomes if o.problem is None]

    @property
    def expired(self) -> list[int]:
        return [o.name for o in self.outcomes if isinstance(o.problem, Expired)]


def test_without_a_clock_nothing_can_be_held():
    with pytest.raises(NotReady):
        Clock().hold(1, "a", 1.0)


def test_a_call_waits_for_the_first_pose_of_its_time_or_later():
    clock = Clock()
    clock.to("a", 0.0)
    clock.hold(1, "", 0.12)
    clock.hold(2, "a", 0.15)
    assert clock.schedule.holding
    assert clock.schedule.under_way
    for stamp in (0.05, 0.1, 0.15, 0.2):
        clock.to("a", stamp)
    assert clock.executed == [(1, 0.15), (2, 0.15)]
    assert not clock.schedule.holding
    assert not clock.schedule.under_way


@pytest.mark.parametrize("at", [0.0, 0.5, 1.0])
def test_a_time_that_has_come_already_is_past(at: float):
    clock = Clock()
    clock.to("a", 1.0)
    with pytest.raises(Expired):
        clock.hold(1, "", at)
    assert clock.outcomes == []


def test_calls_for_a_boot_to_come_wait_for_it_and_go_with_it():
    clock = Clock()
    clock.to("a", 9.0)
    clock.hold(1, "b", 0.0)
    clock.hold(2, "b", 1.0)
    clock.hold(3, "a", 10.0)
    clock.hold(4, "c", 0.0)
    clock.to("a", 9.5)
    assert clock.outcomes == []
    clock.to("b", 0.0)
    assert (clock.executed, clock.expired) == ([(1, 0.0)], [3])
    assert clock.schedule.under_way
    clock.to("d", 5.0)
    assert (clock.executed, clock.expired) == ([(1, 0.0)], [3, 2])
    # The one that is left waits for a boot that may never come, and puts nobody in lock-step.
    assert clock.schedule.holding
    assert not clock.schedule.under_way


def test_after_its_deadline_a_call_is_dropped_whatever_it_waits_for():
    clock = Clock()
    clock.to("a", 0.0, now=100.0)
    clock.hold(1, "a", 1.0, deadline=105.0)
    clock.hold(2, "never", 1.0, deadline=105.0)
    clock.hold(3, "a", 1.0)
    clock.to("a", 1.0, now=105.1)
    assert sorted(clock.expired) == [1, 2]
    assert clock.executed == [(3, 1.0)]


def test_a_call_that_holds_another_is_not_lost():
    clock = Clock()
    clock.to("a", 0.0)
    clock.schedule.schedule(ScheduledCall("a", 1.0, NEVER, lambda _: clock.hold(2, "a", 2.0)))
    clock.to("a", 1.0)
    clock.to("a", 2.0)
    assert clock.executed == [(2, 2.0)]


def test_no_more_than_so_many_are_held(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(server, "MOST", 3)
    clock = Clock()
    clock.to("a", 0.0)
    for name in range(3):
        clock.hold(name, "b", 1.0)
    with pytest.raises(Refused):
        clock.hold(4, "a", 1.0)


BOOTS = st.sampled_from("abc")
TIMES = st.integers(0, 20).map(lambda tick: tick / 10)
DOINGS = st.lists(
    st.one_of(st.tuples(st.just("hold"), BOOTS, TIMES), st.tuples(st.just("tick"), BOOTS, TIMES)),
    max_size=40,
)


@given(DOINGS)
def test_each_is_settled_once_never_early_never_for_another_boot(doings):
    clock, calls = Clock(), {}
    clock.to("a", 0.0)
    for name, (what, boot, time) in enumerate(doings):
        if what == "hold":
            late = boot == clock.boot and time <= clock.stamp
            if late:
                with pytest.raises(Expired):
                    clock.hold(name, boot, time)
            else:
                clock.hold(name, boot, time)
                calls[name] = (boot, time)
        elif boot != clock.boot or time >= clock.stamp:
            before = len(clock.outcomes)
            clock.to(boot, time)
            due = [o.name for o in clock.outcomes[before:] if o.problem is None]
            assert due == sorted(due, key=lambda n: (calls[n][1], n))
        waiting = {n for n, (b, t) in calls.items() if n not in {o.name for o in clock.outcomes}}
        assert clock.schedule.holding == bool(waiting)
        assert clock.schedule.under_way == any(calls[n][0] == clock.boot for n in waiting)
    names = [o.name for o in clock.outcomes]
    assert len(names) == len(set(names))
    for outcome in clock.outcomes:
        boot, at = calls[outcome.name]
        if outcome.problem is None:
            assert (outcome.boot, outcome.stamp >= at) == (boot, True)
