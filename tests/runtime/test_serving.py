"""A service's server, with stand-ins for the queries: each is answered, none is executed twice."""

import time
from typing import Any

import msgspec
import pytest

from quadctl.schemas.services import Call, GotoRequest, GotoResponse
from quadctl.schemas.topics import GOTO
from quadctl.services.runtime import server
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.errors import Invalid, NotReady, Refused
from quadctl.services.runtime.server import Server
from tests.runtime.queries import ASK, KEY, Bench, Query

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
    # Also with other contents, and after its deadline: it is the id that counts.
    assert bench.ask(b"", call=first) == number(1)
    assert bench.ask(call=Call("a", LONG_AGO)) == number(1)
    assert len(bench.executed) == 2


def test_a_repeated_id_gets_the_first_error_too():
    bench = Bench(Refused("no", "wait"))
    call = Call("a", LATER)
    assert bench.fails("refused", call=call) == {"code": "refused", "message": "no", "hint": "wait"}
    bench.fault = None
    assert bench.fails("refused", call=call)["message"] == "no"
    assert len(bench.executed) == 1


def test_what_comes_after_its_deadline_is_not_executed():
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
    ("payload", "encoding", "said"),
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
def test_what_cannot_be_decoded_is_invalid_and_not_executed(
    payload: bytes | None, encoding: str, said: str
):
    bench = Bench()
    assert said in bench.fails("invalid", payload, encoding=encoding)["message"]
    assert bench.executed == []


@pytest.mark.parametrize("attachment", [b"", b"\xc1", codec.encode({"id": "a"}), b"\x80"])
def test_an_attachment_that_cannot_be_read_is_invalid(attachment: bytes):
    bench = Bench()
    bench.fails("invalid", call=attachment)
    assert bench.executed == []


@pytest.mark.parametrize(
    ("fault", "code"),
    [(NotReady("no sample yet", "wait"), "not_ready"), (Refused("no"), "refused"),
     (Invalid("no such name"), "invalid")],
)  # fmt: skip
def test_a_handler_may_refuse(fault: Exception, code: str):
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


def test_a_handlers_answer_that_is_no_message_is_a_fault(caplog: pytest.LogCaptureFixture):
    def wrong(_request: GotoRequest) -> Any:
        return object()

    query: Any = Query()
    Server("uav", GOTO, wrong).answer(query)
    assert query.replies[0][1]["code"] == "internal"


def test_a_call_for_a_time_is_executed_and_answered_then():
    bench = Bench()
    bench.schedule.advance("b", 1.0, 0.0)
    held: Any = Query(call=Call("a", LATER, at=2.0))
    again: Any = Query(call=Call("a", LATER, at=2.0))
    other: Any = Query(call=Call("b", LATER, at=1.5, boot="b"))
    for query in (held, again, other):
        bench.server.answer(query)
    assert (bench.executed, held.replies) == ([], [])
    # What is not for a time does not wait for what is.
    assert bench.ask() == number(1)
    bench.schedule.advance("b", 2.0, 0.0)
    assert other.replies == [number(2)]
    assert held.replies == again.replies == [number(3)]
    assert [query.open for query in (held, again, other)] == [False] * 3
    assert bench.ask(call=Call("a", LATER, at=2.0)) == number(3)
    assert len(bench.executed) == 3


def test_a_call_whose_time_or_boot_is_over_is_not_executed():
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


def test_what_a_held_call_asks_is_checked_when_it_is_executed():
    bench = Bench()
    bench.schedule.advance("b", 1.0, 0.0)
    held: Any = Query(b"nonsense", call=Call("a", LATER, at=2.0))
    bench.server.answer(held)
    bench.schedule.advance("b", 2.0, 0.0)
    assert held.replies[0][1]["code"] == "invalid"


def test_a_handler_can_see_what_goes_with_its_request():
    bench = Bench()
    bench.ask(call=Call("a", LATER, boot="mine"))
    assert bench.server.call == Call("a", LATER, boot="mine")
    bench.ask()
    assert bench.server.call is None
