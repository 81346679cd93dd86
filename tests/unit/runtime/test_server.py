"""Server of a service, with stand-ins for queries: each gets one reply, none runs twice."""

import time
from typing import Any, NamedTuple

import msgspec
import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.services import Call, GotoRequest, GotoResponse
from quadctl.schemas.topics import GOTO
from quadctl.services.runtime import server
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Expired, Invalid, NotReady, QuadctlError, Refused
from quadctl.services.runtime.server import Schedule, ScheduledCall, Server
from tests.support.queries import ASK, KEY, Bench, Query

NEVER = 1e12


class Outcome(NamedTuple):
    name: int
    boot: str
    stamp: float
    problem: QuadctlError | None


class Clock:
    """Schedule, its simulated clock, and the outcomes of its calls."""

    def __init__(self, *, lockstep: bool = True) -> None:
        self.schedule = Schedule(lockstep=lockstep)
        self.boot, self.stamp = "", 0.0
        self.ended: set[str] = set()
        self.outcomes: list[Outcome] = []

    def to(self, boot: str, stamp: float, now: float = 0.0) -> None:
        if boot not in self.ended and not (boot == self.boot and stamp < self.stamp):
            self.ended |= {self.boot} - {boot}
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


def test_without_a_clock_no_call_can_be_scheduled():
    with pytest.raises(NotReady):
        Clock().hold(1, "a", 1.0)


def test_an_earlier_time_or_a_boot_that_has_ended_changes_nothing():
    clock = Clock()
    for boot, stamp in (("a", 1.0), ("a", 0.5), ("b", 0.1), ("a", 2.0)):
        clock.to(boot, stamp)
    assert clock.schedule.now == ("b", 0.1)


def test_a_call_waits_for_the_first_pose_at_its_time_or_later():
    clock = Clock()
    clock.to("a", 0.0)
    clock.hold(1, "", 0.12)
    clock.hold(2, "a", 0.15)
    assert clock.schedule.holding
    for stamp in (0.05, 0.1, 0.15, 0.2):
        clock.to("a", stamp)
    assert clock.executed == [(1, 0.15), (2, 0.15)]
    assert not clock.schedule.holding


@pytest.mark.parametrize("at", [0.0, 0.5, 1.0])
def test_a_call_for_a_past_time_is_expired(at: float):
    clock = Clock()
    clock.to("a", 1.0)
    with pytest.raises(Expired):
        clock.hold(1, "", at)
    assert clock.outcomes == []


def test_calls_for_a_later_boot_wait_for_it_and_expire_with_it():
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
    clock.to("d", 5.0)
    assert (clock.executed, clock.expired) == ([(1, 0.0)], [3, 2])
    # The last call waits for a boot that may never come.
    assert clock.schedule.holding


def test_a_scheduled_call_expires_at_its_deadline():
    clock = Clock()
    clock.to("a", 0.0, now=100.0)
    clock.hold(1, "a", 1.0, deadline=105.0)
    clock.hold(2, "never", 1.0, deadline=105.0)
    clock.hold(3, "a", 1.0)
    clock.to("a", 1.0, now=105.1)
    assert sorted(clock.expired) == [1, 2]
    assert clock.executed == [(3, 1.0)]


def test_a_call_that_schedules_another_does_not_lose_it():
    clock = Clock()
    clock.to("a", 0.0)
    clock.schedule.schedule(ScheduledCall("a", 1.0, NEVER, lambda _: clock.hold(2, "a", 2.0)))
    clock.to("a", 1.0)
    clock.to("a", 2.0)
    assert clock.executed == [(2, 2.0)]


def test_in_real_time_no_call_can_be_scheduled():
    clock = Clock(lockstep=False)
    clock.to("a", 0.0)
    with pytest.raises(Refused, match="real time") as refused:
        clock.hold(1, "a", 1.0)
    assert "dynamics.lockstep=true" in refused.value.hint


def test_settled_calls_with_far_deadlines_take_no_room():
    clock = Clock()
    clock.to("a", 0.0)
    for tick in range(1, 5000):
        clock.hold(tick, "a", tick * 0.1)
        clock.to("a", tick * 0.1)
    assert len(clock.executed) == 4999
    assert len(clock.schedule._deadlines) < 500


BOOTS = st.sampled_from("abc")
TIMES = st.integers(0, 20).map(lambda tick: tick / 10)
ACTIONS = st.lists(
    st.one_of(st.tuples(st.just("hold"), BOOTS, TIMES), st.tuples(st.just("tick"), BOOTS, TIMES)),
    max_size=40,
)


@given(ACTIONS)
def test_each_call_is_settled_once_in_its_boot_and_never_early(actions):
    clock, calls = Clock(), {}
    clock.to("a", 0.0)
    for name, (what, boot, when) in enumerate(actions):
        if what == "hold":
            late = boot == clock.boot and when <= clock.stamp
            if late:
                with pytest.raises(Expired):
                    clock.hold(name, boot, when)
            else:
                clock.hold(name, boot, when)
                calls[name] = (boot, when)
        elif boot != clock.boot or when >= clock.stamp:
            before = len(clock.outcomes)
            clock.to(boot, when)
            due = [o.name for o in clock.outcomes[before:] if o.problem is None]
            assert due == sorted(due, key=lambda n: (calls[n][1], n))
        waiting = {n for n, (b, t) in calls.items() if n not in {o.name for o in clock.outcomes}}
        assert clock.schedule.holding == bool(waiting)
    names = [o.name for o in clock.outcomes]
    assert len(names) == len(set(names))
    for outcome in clock.outcomes:
        boot, at = calls[outcome.name]
        if outcome.problem is None:
            assert (outcome.boot, outcome.stamp >= at) == (boot, True)


LATER, LONG_AGO = time.time() + 1e6, 5.0


def number(count: int) -> tuple[str, GotoResponse]:
    return "ok", GotoResponse(True, f"number {count}")


def test_a_request_is_executed_and_answered():
    bench = Bench()
    assert bench.ask() == number(1)
    assert bench.ask(encoding=codec.encoding(GotoRequest)) == number(2)
    assert bench.ask(encoding=None) == number(3)
    assert bench.executed == [GotoRequest(1.0, 2.0, 3.0)] * 3


def test_a_repeated_id_gets_the_first_reply_and_is_not_executed():
    bench = Bench()
    first = Call("a", LATER)
    assert bench.ask(call=first) == number(1)
    assert bench.ask(call=Call("b", LATER)) == number(2)
    assert bench.ask(call=first) == number(1)
    # Also with other contents and after its deadline: only the id matters.
    assert bench.ask(b"", call=first) == number(1)
    assert bench.ask(call=Call("a", LONG_AGO)) == number(1)
    assert len(bench.executed) == 2


def test_a_repeated_id_gets_the_first_error():
    bench = Bench(Refused("no", "wait"))
    call = Call("a", LATER)
    assert bench.fails("refused", call=call) == {"code": "refused", "message": "no", "hint": "wait"}
    bench.fault = None
    assert bench.fails("refused", call=call)["message"] == "no"
    assert len(bench.executed) == 1


def test_a_call_after_its_deadline_is_not_executed():
    bench = Bench()
    error = bench.fails("expired", call=Call("a", LONG_AGO))
    assert "deadline" in error["message"]
    assert bench.executed == []
    assert bench.ask(call=Call("a", LATER)) == number(1)


def test_the_oldest_ids_are_forgotten(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(server, "_REMEMBERED", 3)
    bench = Bench()
    for name in "abcd":
        bench.ask(call=Call(name, LATER))
    assert bench.ask(call=Call("b", LATER)) == number(2)
    assert bench.ask(call=Call("a", LATER)) == number(5)


@pytest.mark.parametrize(
    "key", ["uav/@srv/*", "*/@srv/goto", "uav/@srv/goto$*", "uav/**", "**", "uav/@srv/goto/x"]
)
def test_a_pattern_is_not_executed(key: str):
    bench = Bench()
    error = bench.fails("invalid", key=key)
    assert key in error["message"]
    assert error["hint"] == f"call {KEY}"
    bench.fails("invalid", key=key, call=Call("a", LATER))
    assert bench.executed == []


@pytest.mark.parametrize(
    ("payload", "encoding", "message"),
    [
        (None, "", "not a valid GotoRequest"),
        (b"", "", "not a valid GotoRequest"),
        (b"\xc1", "", "not a valid GotoRequest"),
        (b"\x91" * 100_000, "", "not a valid GotoRequest"),
        (msgspec.msgpack.encode({"x": 1, "y": 2}), "", "missing required field `z`"),
        (msgspec.msgpack.encode({"x": 1, "y": 2, "z": 3, "w": 4}), "", "unknown field `w`"),
        (msgspec.msgpack.encode({"x": 1, "y": 2, "z": float("nan")}), "", "$.z"),
        (msgspec.msgpack.encode({"x": 1, "y": 2, "z": 10_001}), "", "<= 10000"),
        (ASK, "application/msgpack;quadctl.GotoRequest#0badcafe", "#0badcafe"),
        (ASK, "application/msgpack;quadctl.HoldRequest", "HoldRequest"),
    ],
    ids=["none", "empty", "no msgpack", "deep", "missing", "unknown", "nan", "far", "hash", "type"],
)
def test_an_undecodable_request_is_invalid_and_not_executed(
    payload: bytes | None, encoding: str, message: str
):
    bench = Bench()
    assert message in bench.fails("invalid", payload, encoding=encoding)["message"]
    assert bench.executed == []


@pytest.mark.parametrize("attachment", [b"", b"\xc1", codec.encode({"id": "a"}), b"\x80"])
def test_an_unreadable_attachment_is_invalid(attachment: bytes):
    bench = Bench()
    bench.fails("invalid", call=attachment)
    assert bench.executed == []


@pytest.mark.parametrize(
    ("fault", "code"),
    [(NotReady("no sample yet", "wait"), "not_ready"), (Refused("no"), "refused"),
     (Invalid("no such name"), "invalid")],
)  # fmt: skip
def test_an_error_of_a_handler_is_sent_to_the_caller(fault: Exception, code: str):
    assert Bench(fault).fails(code)["message"] == str(fault)


@pytest.mark.parametrize("fault", [ZeroDivisionError("secret"), KeyError(1), RecursionError()])
def test_a_fault_in_a_handler_is_answered_and_logged(
    fault: Exception, caplog: pytest.LogCaptureFixture
):
    bench = Bench(fault)
    error = bench.fails("internal")
    assert KEY in error["message"]
    assert "secret" not in error["message"]
    assert caplog.records[0].exc_info is not None
    bench.fault = None
    assert bench.ask() == number(2)


def test_a_reply_of_the_wrong_type_is_an_internal_error(caplog: pytest.LogCaptureFixture):
    def wrong(_request: GotoRequest) -> Any:
        return object()

    query: Any = Query()
    Server("uav", GOTO, wrong, Schedule(lockstep=False)).answer(query)
    assert query.replies[0][1]["code"] == "internal"


def test_a_call_for_a_time_is_executed_at_that_time():
    bench = Bench()
    bench.schedule.advance("b", 1.0, 0.0)
    held: Any = Query(call=Call("a", LATER, at=2.0))
    again: Any = Query(call=Call("a", LATER, at=2.0))
    other: Any = Query(call=Call("b", LATER, at=1.5, boot="b"))
    for query in (held, again, other):
        bench.server.answer(query)
    assert (bench.executed, held.replies) == ([], [])
    # A call without a time does not wait for scheduled ones.
    assert bench.ask() == number(1)
    bench.schedule.advance("b", 2.0, 0.0)
    assert other.replies == [number(2)]
    assert held.replies == again.replies == [number(3)]
    assert [query.open for query in (held, again, other)] == [False] * 3
    assert bench.ask(call=Call("a", LATER, at=2.0)) == number(3)
    assert len(bench.executed) == 3


def test_a_call_for_a_past_time_or_boot_is_not_executed():
    bench = Bench()
    bench.fails("not_ready", call=Call("early", LATER, at=5.0))
    bench.schedule.advance("b", 1.0, 0.0)
    assert "it is 1 s" in bench.fails("expired", call=Call("late", LATER, at=1.0))["message"]
    held: Any = Query(call=Call("a", LATER, at=2.0))
    bench.server.answer(held)
    bench.schedule.advance("c", 0.0, 0.0)
    ((kind, error),) = held.replies
    assert (kind, error["code"], held.open) == ("error", "expired", False)
    assert bench.fails("expired", call=Call("a", LATER)) == error
    assert bench.executed == []


@pytest.mark.parametrize(("later", "kind"), [(900, "ok"), (1100, "error")])
def test_a_clock_that_is_set_changes_no_deadline_of_a_call_that_waits(later: float, kind: str):
    bench = Bench()
    bench.schedule.advance("b", 1.0, 0.0)
    held: Any = Query(call=Call("a", time.time() + 1000, at=2.0))
    bench.server.answer(held)
    bench.schedule.advance("b", 2.0, time.monotonic() + later)
    assert [answer for answer, _ in held.replies] == [kind]


@pytest.mark.parametrize(
    ("limit", "step", "reason"),
    [("MOST", 1.0, "already waiting"), ("_AT_ONCE", 0.0, "for this time, 2 s")],
)
def test_the_number_of_scheduled_calls_is_limited(
    monkeypatch: pytest.MonkeyPatch, limit: str, step: float, reason: str
):
    monkeypatch.setattr(server, limit, 3)
    bench = Bench()
    bench.schedule.advance("b", 1.0, 0.0)
    for number in range(3):
        held: Any = Query(call=Call(f"{number}", LATER, at=2.0 + number * step))
        bench.server.answer(held)
        assert held.replies == []
    assert reason in bench.fails("refused", call=Call("more", LATER, at=2.0))["message"]
    bench.schedule.advance("b", 5.0, 0.0)
    bench.schedule.advance("b", 5.0, 0.0)
    assert len(bench.executed) == 3
    again: Any = Query(call=Call("again", LATER, at=6.0))
    bench.server.answer(again)
    assert again.replies == []


def test_of_a_call_asked_again_and_again_the_newest_queries_are_answered():
    bench = Bench()
    bench.schedule.advance("b", 1.0, 0.0)
    queries: list[Any] = [Query(call=Call("a", LATER, at=2.0)) for _ in range(20)]
    for query in queries:
        bench.server.answer(query)
    bench.schedule.advance("b", 2.0, 0.0)
    answered = [bool(query.replies) for query in queries]
    assert answered == [False] * 12 + [True] * 8
    assert len(bench.executed) == 1


def test_the_request_of_a_scheduled_call_is_decoded_at_its_time():
    bench = Bench()
    bench.schedule.advance("b", 1.0, 0.0)
    held: Any = Query(b"nonsense", call=Call("a", LATER, at=2.0))
    bench.server.answer(held)
    bench.schedule.advance("b", 2.0, 0.0)
    assert held.replies[0][1]["code"] == "invalid"


def test_a_handler_can_read_the_calls_attachment():
    bench = Bench()
    bench.ask(call=Call("a", LATER, boot="mine"))
    assert bench.server.call == Call("a", LATER, boot="mine")
    bench.ask()
    assert bench.server.call is None
