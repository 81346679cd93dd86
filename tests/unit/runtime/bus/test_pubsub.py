"""A topic's messages between Zenoh's thread and a node's loop, with stand-ins for the samples."""

import logging
from collections.abc import Callable
from math import inf
from typing import Any

import pytest

from quadctl.schemas.messages import Waypoint
from quadctl.schemas.topics import REQUEST
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.pubsub import Subscription


class Sample:
    """What Zenoh hands over."""

    def __init__(self, payload: bytes, encoding: str = "") -> None:
        self.payload, self.encoding, self._data = self, encoding, payload

    def to_bytes(self) -> bytes:
        return self._data


class Bench:
    """A subscription, its loop's inbox, and what its handler heard."""

    def __init__(self, depth: int = 64, *, handled: bool = True) -> None:
        self.inbox: list[Callable[[], None]] = []
        self.heard: list[float] = []
        self.awaited = False
        handler: Any = (lambda waypoint: self.heard.append(waypoint.x)) if handled else None
        self.subscription: Subscription[Waypoint] = Subscription(
            REQUEST, self.inbox.append, self.inbox.append, lambda: self.awaited, handler, depth
        )

    def comes(self, *numbers: float) -> None:
        for number in numbers:
            self.comes_raw(codec.encode(Waypoint(number, 0.0, 0.0)), codec.encoding(Waypoint))

    def comes_raw(self, payload: bytes, encoding: str = "") -> None:
        sample: Any = Sample(payload, encoding)
        self.subscription.on_sample(sample)

    def turn(self) -> None:
        """One turn of the loop."""
        waiting, self.inbox[:] = list(self.inbox), []
        for item in waiting:
            item()


def test_before_the_first_there_is_none():
    bench = Bench()
    assert bench.subscription.value is None
    assert bench.subscription.age == inf


def test_nothing_is_decoded_or_handled_before_the_loops_turn():
    bench = Bench()
    bench.comes(1)
    assert bench.subscription.value is None
    assert bench.heard == []
    bench.turn()
    assert bench.subscription.value == Waypoint(1.0, 0.0, 0.0)
    assert bench.heard == [1]


def test_all_are_handled_in_order_and_the_newest_is_kept():
    bench = Bench()
    bench.comes(1, 2, 3)
    bench.turn()
    bench.comes(4)
    bench.turn()
    assert bench.heard == [1, 2, 3, 4]
    assert bench.subscription.value == Waypoint(4.0, 0.0, 0.0)


def test_the_inbox_gets_one_entry_for_a_burst():
    bench = Bench()
    bench.comes(*range(50))
    assert len(bench.inbox) == 1
    bench.turn()
    bench.comes(1)
    assert len(bench.inbox) == 1


def test_beyond_its_depth_the_oldest_are_dropped():
    bench = Bench(depth=3)
    bench.comes(*range(10))
    bench.turn()
    assert bench.heard == [7, 8, 9]


def test_without_a_handler_the_newest_is_kept_all_the_same():
    bench = Bench(handled=False)
    bench.comes(1, 2)
    bench.turn()
    assert bench.subscription.value == Waypoint(2.0, 0.0, 0.0)


def test_its_age_is_from_its_arrival_not_from_its_reading(monkeypatch: pytest.MonkeyPatch):
    now = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    bench = Bench()
    bench.comes(1)
    now = 101.5
    bench.turn()
    assert bench.subscription.received == 100.0
    assert bench.subscription.age == 1.5


BAD = [
    b"",
    b"\xc1",
    codec.encode({"x": float("nan"), "y": 0, "z": 0}),
    b"\x81\xa1q" + b"\x91" * 99_999,
]


@pytest.mark.parametrize("payload", BAD, ids=["empty", "no msgpack", "nan", "deep"])
def test_a_bad_message_is_passed_over_with_a_complaint(
    payload: bytes, caplog: pytest.LogCaptureFixture
):
    bench = Bench()
    bench.comes(1)
    bench.comes_raw(payload)
    bench.comes(2)
    bench.turn()
    assert bench.heard == [1, 2]
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith("ignored a message on input/position_request: not a valid")
    assert caplog.records[0].levelno == logging.WARNING


def test_the_same_complaint_is_made_once_and_another_again(caplog: pytest.LogCaptureFixture):
    bench = Bench()
    for payload in (b"", b"", b"\xc1", b"\xc1", b""):
        bench.comes_raw(payload)
        bench.turn()
    assert len(caplog.messages) == 3
    assert bench.subscription.age == inf


def test_another_version_of_the_type_is_refused_by_hash(caplog: pytest.LogCaptureFixture):
    bench = Bench()
    bench.comes_raw(
        codec.encode(Waypoint(1.0, 0.0, 0.0)), "application/msgpack;quadctl.Waypoint#0badcafe"
    )
    bench.turn()
    assert bench.heard == []
    assert "0badcafe" in caplog.text
    assert codec.encoding(Waypoint).rpartition("#")[2] in caplog.text


def test_a_flood_is_let_gather_and_what_came_last_in_it_is_heard(monkeypatch: pytest.MonkeyPatch):
    now, naps = [100.0], list[float]()
    monkeypatch.setattr("quadctl.services.runtime.bus.pubsub.time.monotonic", lambda: now[0])
    monkeypatch.setattr("quadctl.services.runtime.bus.pubsub.time.sleep", naps.append)
    bench = Bench()
    for number in range(600):
        now[0] += 0.00001
        bench.comes(number)
        bench.turn()
    assert naps, "100 000 a second are a flood"
    bench.comes(600, 601)
    assert len(bench.inbox) == 1
    bench.turn()
    assert bench.heard == list(range(602))
    now[0] += 1.0
    for _ in range(3):
        bench.turn()
    naps.clear()
    assert bench.inbox == []
    for number in range(50):
        now[0] += 0.001
        bench.comes(number)
        bench.turn()
    assert len(naps) <= 1, "1000 a second are none"
