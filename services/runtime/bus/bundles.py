"""Bundles: topics between the processes of a run, one message a period for all its vehicles.

A message for each vehicle wakes each process on its way once for each; a hundred parts of one message
wake it once. Only the processes of a run take bundles: their keys begin with the run's first vehicle and
the chunk `@all`, which wildcards do not match and which is no role's. Others subscribe to the topics.

A bundle has the number of its process, the beats that this has counted, and messages. With a message of a
vehicle at rest comes a step: at each further beat the vehicle repeats it, with a number so much higher. So
one that rests costs nothing, neither its own process nor others, and a beat shows that all still rest.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import partial
from typing import Any

import zenoh
from msgspec import Raw, Struct, msgpack
from msgspec.structs import replace

from quadctl.schemas.messages import Pose
from quadctl.schemas.topics import POSE_SLOW, SETPOINT, Topic
from quadctl.services.runtime.bus import codec, zenoh_events
from quadctl.services.runtime.bus.pubsub import Beats, Bundle, BundlePart, Subscription
from quadctl.services.runtime.executor import Outbox

_BUNDLED = (POSE_SLOW, SETPOINT)
_UNREAD = 1_000
"""Bundles that may wait for a loop."""
_DIGITS = 3
"""Digits of a stamp (s) after the point: it counts steps of 1 ms."""
_log = logging.getLogger(__name__)
_undecoded = msgpack.Decoder(tuple[int, int, list[tuple[str, Raw, int]]])


class _Inbox:
    """Bundles of one topic on their way to the subscriptions of vehicles."""

    def __init__(
        self, topic: Topic[Any], key: str, outbox: Outbox, waits: Callable[[], bool]
    ) -> None:
        """Read each bundle at once while a loop `waits()` for something."""
        self._topic, self._key, self._outbox, self._waits = topic, key, outbox, waits
        self._takers: dict[str, list[Subscription[Any]]] = {}
        self._eager: list[Subscription[Any]] = []
        self._waking: list[Subscription[Any]] = []
        """Subscriptions that want each repetition as a message, and those that may wake their loop by themselves."""
        self._unread: deque[tuple[float, bytes]] = deque(maxlen=_UNREAD)
        self._reading = threading.RLock()  # what a message wakes may read on
        self._process, self._beats = 0, Beats()
        type_: Any = topic.type
        bundle: Any = tuple[int, int, list[tuple[str, type_, int]]]
        self._decoder: Any = codec.decoder(bundle)

    def add(self, vehicle: str, subscription: Subscription[Any]) -> Callable[[], None]:
        """Pass a vehicle's messages on to a subscription, until the result is called."""
        takers = self._takers.setdefault(vehicle, [])
        takers.append(subscription)
        if not subscription.skips:
            self._eager.append(subscription)
        if subscription.may_wake:
            self._waking.append(subscription)
        subscription.pull = self.read
        return partial(self._remove, takers, subscription)

    def _remove(self, takers: list[Subscription[Any]], subscription: Subscription[Any]) -> None:
        for some in (takers, self._eager, self._waking):
            if subscription in some:
                some.remove(subscription)

    def on_bundle(self, sample: zenoh.Sample) -> None:
        """Take a bundle, on a Zenoh thread; one that no loop waits for is read later, with others."""
        zenoh_events.pin_thread_state()
        self._unread.append((time.monotonic(), sample.payload.to_bytes()))
        if self._waits() or any(each.is_awaited for each in self._waking.copy()):
            self.read()
            # Answers to all of them go out together.
            self._outbox.flush()

    def read(self) -> None:
        """Pass on what has come."""
        if self._unread:
            # Two threads that took turns would mix the messages up.
            with self._reading:
                while self._unread:
                    self._pass_on(*self._unread.popleft())

    def _pass_on(self, now: float, payload: bytes) -> None:
        try:
            process, count, parts, encoding = self._parts_of(payload)
        except codec.UNREADABLE as error:
            _log.warning("ignored a message on %s: %s", self._key, error)
            return
        if process != self._process:
            # Whatever rested by the beats of one that ended repeats nothing any more.
            self._process, self._beats = process, Beats()
        beats = self._beats
        beats.received = now
        for vehicle, message, rest in parts:
            for subscription in self._takers.get(vehicle, ()):
                if rest:
                    subscription.take_rest(now, message, beats, count, partial(_later, rest))
                else:
                    subscription.take(now, message, encoding)
        if count != beats.count:
            beats.count = count
            for subscription in self._eager.copy():
                subscription.take_beat()

    def _parts_of(self, payload: bytes) -> tuple[int, int, list[tuple[str, Any, int]], str]:
        """Return a process, its beats, messages of vehicles with their steps, and the encoding of undecoded ones.

        What waits for its loop for a second is a quarter as large undecoded: decoded, the poses of a hundred
        vehicles leave the processor's caches. Nor must one bad message cost the other vehicles theirs.
        """
        if self._eager or self._waking:
            with suppress(*codec.UNREADABLE):
                return *self._decoder.decode(payload), ""
        process, count, undecoded = _undecoded.decode(payload)
        parts = [(vehicle, *self._part(part, rest)) for vehicle, part, rest in undecoded]
        return process, count, parts, _encoding(self._topic)

    def _part(self, part: Raw, rest: int) -> tuple[Any, int]:
        """Return a message and its step: decoded if the vehicle repeats it."""
        if rest:
            type_: Any = self._topic.type
            with suppress(*codec.UNREADABLE):
                return codec.decoder(type_).decode(part), rest
        return bytes(part), 0


def _later(step: int, pose: Pose, periods: int) -> Pose:
    """Return a pose as it is some periods later, at rest."""
    stamp = round(pose.stamp + periods / POSE_SLOW.hz, _DIGITS)
    return replace(pose, seq=pose.seq + periods * step, stamp=stamp)


class Bundles:
    """Bundles of a process: those that it sends, and those that it takes."""

    def __init__(
        self, session: zenoh.Session, lead: str, senders: Collection[str], outbox: Outbox
    ) -> None:
        """Use the keys of the run's first vehicle, `lead`; `senders` are its nodes that send bundles."""
        self._session, self._lead = session, lead
        self._senders, self._outbox = senders, outbox
        self._out: dict[str, Bundle] = {}
        self._in: dict[str, _Inbox] = {}
        self.waits = 0
        """Loops that wait for something, which any message may be."""
        self._subscribers: list[zenoh.Subscriber[None]] = []

    def has(self, topic: Topic[Any]) -> bool:
        """Return whether the topic's messages come in bundles."""
        return topic in _BUNDLED and topic.node in self._senders

    def out(self, topic: Topic[Any], vehicle: str) -> BundlePart | None:
        """Return a vehicle's part of the bundle that a topic's messages go out in, None if they go in none."""
        if topic not in _BUNDLED:
            return None
        if topic.name not in self._out:
            encoding = _encoding(topic)
            self._out[topic.name] = Bundle(self._session, self._key(topic), encoding, self._outbox)
        return BundlePart(self._out[topic.name], vehicle)

    def subscribe(
        self, topic: Topic[Any], vehicle: str, subscription: Subscription[Any]
    ) -> Callable[[], None]:
        """Pass a vehicle's messages of a topic on to a subscription, until the result is called."""
        if topic.name not in self._in:
            self._in[topic.name] = inbox = _Inbox(
                topic, self._key(topic), self._outbox, lambda: self.waits > 0
            )
            callback = zenoh.handlers.Callback(inbox.on_bundle, indirect=False)
            self._subscribers.append(self._session.declare_subscriber(self._key(topic), callback))
        return self._in[topic.name].add(vehicle, subscription)

    def _key(self, topic: Topic[Any]) -> str:
        return f"{self._lead}/@all/{topic.name}"


def _encoding(topic: Topic[Any]) -> str:
    type_: type[Struct] = topic.type
    return codec.encoding(type_)
