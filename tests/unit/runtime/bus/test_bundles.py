"""What a bundle tells of vehicles at rest, by a sender and a receiver without a bus."""

from collections import deque
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh
from hypothesis import given, strategies as st
from msgspec.structs import replace

from quadctl.schemas.messages import Pose
from quadctl.schemas.topics import POSE_SLOW
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.bundles import _Inbox
from quadctl.services.runtime.bus.pubsub import Bundle, Subscription
from quadctl.services.runtime.executor import Outbox
from tests.support.bags import pose

STEP = 5
"""Poses in a period."""
NAMES = ["uav0", "uav1", "uav2"]


class Wire:
    """Zenoh session with one key, on which messages wait until they are let through."""

    def __init__(self) -> None:
        self.sent: deque[bytes] = deque()
        self.matching_status = SimpleNamespace(matching=True)

    def declare_publisher(self, _key: str, **_: Any) -> "Wire":
        return self

    def declare_matching_listener(self, _callback: Any) -> None:
        pass

    def put(self, payload: bytes) -> None:
        self.sent.append(payload)


class Flights:
    """Vehicles that move at some periods and rest at others, and a process that receives their poses."""

    def __init__(self, *, skips: bool, wakes: bool = True) -> None:
        self.wire, self.outbox = Wire(), Outbox()
        session = cast("zenoh.Session", self.wire)
        self.bundle = Bundle(session, "", codec.encoding(Pose), self.outbox)
        self.true = {name: [pose(0)] for name in NAMES}
        self.resting: set[str] = set()
        self.inbox = _Inbox(POSE_SLOW, "", self.outbox, lambda: False)
        self.got: dict[str, list[Pose]] = {name: [] for name in NAMES}
        self.subscriptions = {
            name: Subscription(
                POSE_SLOW, lambda item: item(), lambda item: item(), lambda: False,
                self.got[name].append, 100, wakes=wakes, skips=skips,
            )
            for name in NAMES
        }  # fmt: skip
        for name, subscription in self.subscriptions.items():
            self.inbox.add(name, subscription)

    def period(self, moves: dict[str, bool], *, after_beat: bool) -> None:
        """Let a period pass; the vehicles other than the first tick with it, or between two beats."""
        if after_beat:
            self.beat(moves=moves["uav0"])
            self.outbox.flush()
        for name in NAMES[1:]:
            self.tick(name, moves=moves[name])
        if not after_beat:
            self.beat(moves=moves["uav0"])
        self.outbox.flush()

    def beat(self, *, moves: bool) -> None:
        self.bundle.beat()
        self.bundle.add("uav0", self.fly("uav0", moves=moves), 0)

    def tick(self, name: str, *, moves: bool) -> None:
        flown = self.fly(name, moves=moves)
        if moves:
            self.resting.discard(name)
            self.bundle.add(name, flown, 0)
        elif name not in self.resting:
            self.resting.add(name)
            self.bundle.add(name, flown, STEP)

    def fly(self, name: str, *, moves: bool) -> Pose:
        last = self.true[name][-1]
        count = len(self.true[name])
        place = replace(last.position, x=last.position.x + moves)
        new = replace(last, seq=count * STEP, stamp=round(count * 0.05, 3), position=place)
        self.true[name].append(new)
        return new

    def deliver(self) -> None:
        while self.wire.sent:
            payload = self.wire.sent.popleft()
            self.inbox.on_bundle(cast("zenoh.Sample", SimpleNamespace(payload=_Bytes(payload))))


class _Bytes(bytes):
    def to_bytes(self) -> bytes:
        return self


periods = st.lists(st.fixed_dictionaries({name: st.booleans() for name in NAMES}), max_size=30)


@given(periods, st.booleans(), st.lists(st.booleans(), min_size=30, max_size=30), st.booleans())
def test_each_pose_that_is_passed_on_is_one_that_its_vehicle_had(
    moves: list[dict[str, bool]], after_beat: bool, looks: list[bool], wakes: bool
):
    flights = Flights(skips=True, wakes=wakes)
    for each, look in zip(moves, looks, strict=False):
        flights.period(each, after_beat=after_beat)
        flights.deliver()
        for subscription in flights.subscriptions.values() if look else ():
            subscription.poll()
    for subscription in flights.subscriptions.values():
        subscription.poll()
    for name in NAMES:
        got, had = flights.got[name], flights.true[name]
        assert all(each in had for each in got)
        assert got == sorted(got, key=lambda each: each.stamp)
        # What was not repeated is never skipped.
        changed = {
            each.seq
            for each, before in zip(had[1:], had, strict=False)
            if each.position != before.position
        }
        assert changed <= {each.seq for each in got}


@given(periods.filter(bool), st.booleans())
def test_the_newest_pose_is_at_most_a_period_old(moves: list[dict[str, bool]], wakes: bool):
    flights = Flights(skips=True, wakes=wakes)
    for each in moves:
        flights.period(each, after_beat=True)
        flights.deliver()
        for name, subscription in flights.subscriptions.items():
            subscription.poll()
            assert flights.true[name][-1].seq - flights.got[name][-1].seq in {0, STEP}


def test_who_does_not_skip_receives_a_pose_each_period():
    flights = Flights(skips=False)
    for _ in range(10):
        flights.period(dict.fromkeys(NAMES, False), after_beat=True)
        flights.deliver()
    for name in NAMES:
        assert flights.got[name] == flights.true[name][1:]


def test_the_beats_of_another_process_repeat_nothing():
    flights = Flights(skips=True)
    for _ in range(3):
        flights.period(dict.fromkeys(NAMES, False), after_beat=True)
    flights.wire.sent.extend(codec.encode((0, beat, [])) for beat in range(50))
    flights.deliver()
    flights.subscriptions["uav1"].poll()
    assert flights.got["uav1"][-1] in flights.true["uav1"]


@pytest.mark.parametrize("lost", range(1, 9))
def test_a_lost_bundle_costs_no_time(lost: int):
    flights = Flights(skips=True)
    for number in range(10):
        flights.period(dict.fromkeys(NAMES, False), after_beat=True)
        if number == lost:
            flights.wire.sent.clear()
        flights.deliver()
    flights.subscriptions["uav1"].poll()
    assert flights.got["uav1"][-1] in flights.true["uav1"][-2:]
