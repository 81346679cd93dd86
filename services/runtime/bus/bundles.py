"""Bundles: topics between the processes of a run, one message a period for all its vehicles.

A message for each vehicle wakes each process on its way once for each; a hundred parts of one message
wake it once. Only the processes of a run take bundles: their keys begin with the run's first vehicle and
the chunk `@all`, which wildcards do not match and which is no role's. Others subscribe to the topics.
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

import zenoh
from msgspec import Raw, Struct, msgpack

from quadctl.schemas.topics import POSE_SLOW, SETPOINT, Topic
from quadctl.services.runtime.bus import codec, zenoh_events
from quadctl.services.runtime.bus.pubsub import Subscription
from quadctl.services.runtime.executor import Outbox

_BUNDLED = (POSE_SLOW, SETPOINT)
_MOST = 128
"""Messages of a bundle, some 30 kB: Zenoh sends more than 64 kB in pieces."""
_log = logging.getLogger(__name__)
_parts = msgpack.Decoder(list[tuple[str, Raw]])


class Bundle:
    """Messages of one topic, of several vehicles, that wait to go out together."""

    def __init__(self, session: zenoh.Session, key: str, encoding: str, outbox: Outbox) -> None:
        """Declare the key; messages go out when the outbox is flushed."""
        self._publisher = session.declare_publisher(
            key, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
        )
        self._matches = zenoh_events.MatchingListener(self._publisher)
        self._waiting: deque[tuple[str, Struct]] = deque()
        self._outbox = outbox

    def add(self, vehicle: str, message: Struct) -> None:
        """Add a vehicle's message, if there is a process to take it; safe to call from any thread."""
        if self._matches.was_there:
            self._waiting.append((vehicle, message))
            self._outbox.add(self._send)

    def _send(self) -> None:
        while count := min(len(self._waiting), _MOST):
            self._publisher.put(codec.encode([self._waiting.popleft() for _ in range(count)]))


class Bundles:
    """Bundles of a process: those that it sends, and those that it takes."""

    def __init__(
        self, session: zenoh.Session, lead: str, senders: Collection[str], outbox: Outbox
    ) -> None:
        """Use the keys of the run's first vehicle, `lead`; `senders` are its nodes that send bundles."""
        self._session, self._lead = session, lead
        self._senders, self._outbox = senders, outbox
        self._out: dict[str, Bundle] = {}
        self._in: dict[str, dict[str, list[Subscription[Any]]]] = {}
        self._subscribers: list[zenoh.Subscriber[None]] = []

    def has(self, topic: Topic[Any]) -> bool:
        """Return whether the topic's messages come in bundles."""
        return topic in _BUNDLED and topic.node in self._senders

    def out(self, topic: Topic[Any], vehicle: str) -> Callable[[Struct], None] | None:
        """Return a function that sends a vehicle's message of a topic; None if that goes in no bundle."""
        if topic not in _BUNDLED:
            return None
        if topic.name not in self._out:
            encoding = _encoding(topic)
            self._out[topic.name] = Bundle(self._session, self._key(topic), encoding, self._outbox)
        return partial(self._out[topic.name].add, vehicle)

    def subscribe(
        self, topic: Topic[Any], vehicle: str, subscription: Subscription[Any]
    ) -> Callable[[], None]:
        """Pass a vehicle's messages of a topic on to a subscription, until the result is called."""
        if topic.name not in self._in:
            self._in[topic.name] = {}
            callback = zenoh.handlers.Callback(partial(self._on_bundle, topic), indirect=False)
            self._subscribers.append(self._session.declare_subscriber(self._key(topic), callback))
        takers = self._in[topic.name].setdefault(vehicle, [])
        takers.append(subscription)
        return partial(takers.remove, subscription)

    def _key(self, topic: Topic[Any]) -> str:
        return f"{self._lead}/@all/{topic.name}"

    def _on_bundle(self, topic: Topic[Any], sample: zenoh.Sample) -> None:
        zenoh_events.pin_thread_state()
        now, takers, payload = time.monotonic(), self._in[topic.name], sample.payload.to_bytes()
        type_: Any = topic.type
        bundle: Any = list[tuple[str, type_]]
        encoding = ""
        try:
            parts: list[tuple[str, Any]] = codec.decoder(bundle).decode(payload)
        except codec.UNREADABLE:
            # One bad message must not cost the other vehicles theirs.
            encoding = _encoding(topic)
            try:
                parts = [(vehicle, bytes(part)) for vehicle, part in _parts.decode(payload)]
            except codec.UNREADABLE as error:
                _log.warning("ignored a message on %s: %s", self._key(topic), error)
                return
        for vehicle, message in parts:
            for subscription in takers.get(vehicle, ()):
                subscription.take(now, message, encoding)
        # Answers to all of them go out together.
        self._outbox.flush()


def _encoding(topic: Topic[Any]) -> str:
    type_: type[Struct] = topic.type
    return codec.encoding(type_)
