"""Subscription between Zenoh's thread and a node's executor, with stand-ins for samples."""

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
    """Stand-in for a Zenoh sample."""

    def __init__(self, payload: bytes, encoding: str = "") -> None:
        self.payload, self.encoding, self._data = self, encoding, payload

    def to_bytes(self) -> bytes:
        return self._data


class Bench:
    """Subscription with a callback queue and the values that its handler received."""

    def __init__(self, depth: int = 64, *, handled: bool = True, wakes: bool = True) -> None:
        self.queue: list[Callable[[], None]] = []
        self.handled_values: list[float] = []
        self.awaited = False
        handler: Any = (
            (lambda waypoint: self.handled_values.append(waypoint.x)) if handled else None
        )
        self.subscription: Subscription[Waypoint] = Subscription(
            REQUEST,
            self.queue.append,
            self.queue.append,
            lambda: self.awaited,
            handler,
            depth,
            wakes=wakes,
        )

    def receive(self, *numbers: float) -> None:
        for number in numbers:
            self.receive_raw(codec.encode(Waypoint(number, 0.0, 0.0)), codec.encoding(Waypoint))

    def receive_raw(self, payload: bytes, encoding: str = "") -> None:
        sample: Any = Sample(payload, encoding)
        self.subscription.on_sample(sample)

    def turn(self) -> None:
        """Run the queued callbacks once."""
        waiting, self.queue[:] = list(self.queue), []
        for item in waiting:
            item()


def test_before_the_first_message_there_is_no_value():
    bench = Bench()
    assert bench.subscription.value is None
    assert bench.subscription.age == inf


def test_messages_are_decoded_only_in_the_executors_turn():
    bench = Bench()
    bench.receive(1)
    assert bench.subscription.value is None
    assert bench.handled_values == []
    bench.turn()
    assert bench.subscription.value == Waypoint(1.0, 0.0, 0.0)
    assert bench.handled_values == [1]


def test_messages_are_handled_in_order_and_the_newest_is_kept():
    bench = Bench()
    bench.receive(1, 2, 3)
    bench.turn()
    bench.receive(4)
    bench.turn()
    assert bench.handled_values == [1, 2, 3, 4]
    assert bench.subscription.value == Waypoint(4.0, 0.0, 0.0)


def test_a_burst_adds_one_entry_to_the_queue():
    bench = Bench()
    bench.receive(*range(50))
    assert len(bench.queue) == 1
    bench.turn()
    bench.receive(1)
    assert len(bench.queue) == 1


def test_beyond_the_depth_the_oldest_messages_are_dropped():
    bench = Bench(depth=3)
    bench.receive(*range(10))
    bench.turn()
    assert bench.handled_values == [7, 8, 9]


def test_without_a_handler_the_newest_message_is_kept():
    bench = Bench(handled=False)
    bench.receive(1, 2)
    bench.turn()
    assert bench.subscription.value == Waypoint(2.0, 0.0, 0.0)


def test_the_age_counts_from_the_arrival_not_the_decoding(monkeypatch: pytest.MonkeyPatch):
    now = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    bench = Bench()
    bench.receive(1)
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
def test_a_bad_message_is_skipped_with_a_warning(payload: bytes, caplog: pytest.LogCaptureFixture):
    bench = Bench()
    bench.receive(1)
    bench.receive_raw(payload)
    bench.receive(2)
    bench.turn()
    assert bench.handled_values == [1, 2]
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith("ignored a message on input/position_request: not a valid")
    assert caplog.records[0].levelno == logging.WARNING


def test_the_same_warning_is_logged_only_once_in_a_row(caplog: pytest.LogCaptureFixture):
    bench = Bench()
    for payload in (b"", b"", b"\xc1", b"\xc1", b""):
        bench.receive_raw(payload)
        bench.turn()
    assert len(caplog.messages) == 3
    assert bench.subscription.age == inf


def test_another_version_of_the_type_is_rejected_by_hash(caplog: pytest.LogCaptureFixture):
    bench = Bench()
    bench.receive_raw(
        codec.encode(Waypoint(1.0, 0.0, 0.0)), "application/msgpack;quadctl.Waypoint#0badcafe"
    )
    bench.turn()
    assert bench.handled_values == []
    assert "0badcafe" in caplog.text
    assert codec.encoding(Waypoint).rpartition("#")[2] in caplog.text


def test_a_flood_is_batched_without_losing_the_last_messages(monkeypatch: pytest.MonkeyPatch):
    now, naps = [100.0], list[float]()
    monkeypatch.setattr("quadctl.services.runtime.bus.pubsub.time.monotonic", lambda: now[0])
    monkeypatch.setattr("quadctl.services.runtime.bus.pubsub.time.sleep", naps.append)
    bench = Bench()
    for number in range(600):
        now[0] += 0.00001
        bench.receive(number)
        bench.turn()
    assert naps, "100 000 messages a second are a flood"
    bench.receive(600, 601)
    assert len(bench.queue) == 1
    bench.turn()
    assert bench.handled_values == list(range(602))
    now[0] += 1.0
    for _ in range(3):
        bench.turn()
    naps.clear()
    assert bench.queue == []
    for number in range(50):
        now[0] += 0.001
        bench.receive(number)
        bench.turn()
    assert len(naps) <= 1, "1000 messages a second are no flood"


def test_a_topic_that_does_not_wake_waits_for_the_next_poll():
    bench = Bench(wakes=False)
    bench.receive(1.0, 2.0)
    assert (bench.queue, bench.handled_values) == ([], [])
    bench.subscription.poll()
    assert bench.handled_values == [1.0, 2.0]
    bench.awaited = True
    bench.receive(3.0)
    assert len(bench.queue) == 1
