"""Undecoded traffic: the recorder's subscriber and the replay's publisher."""

import contextlib
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh

from quadctl.schemas import keyexpr
from quadctl.schemas.topics import topic_of
from quadctl.services.runtime.bus import codec, liveliness, zenoh_events
from quadctl.services.runtime.bus.zenoh_events import DisconnectListener
from quadctl.services.runtime.errors import AlreadyServed, TimedOut

NAME = "replay"


class ReplayPublisher:
    """Publisher of recorded keys in place of their nodes; `keys` has the encoding of each.

    The keys are listed as the nodes listed them, and latched topics answer `get`. Raises
    AlreadyServed if a key has a publisher; a live vehicle publishes all of its keys.
    """

    def __init__(self, session: zenoh.Session, keys: dict[str, str]) -> None:
        vehicles = {key.partition("/")[0] for key in keys}
        for vehicle in sorted(vehicles):
            _refuse_live(session, vehicle, keys)
        self._publishers = {key: _KeyPublisher(session, key) for key in keys}
        tokens = [*map(keyexpr.endpoint_key, _offers(keys))]
        # The nodes' tokens last: a client that sees a node may call it at once.
        tokens += [keyexpr.node_key(vehicle, NAME) for vehicle in vehicles]
        self._tokens = [session.liveliness().declare_token(token) for token in tokens]

    def put(self, key: str, payload: bytes, encoding: str) -> None:
        """Publish a message."""
        self._publishers[key].put(payload, encoding)


class _KeyPublisher:
    """Publisher of one key; for a latched topic it answers with the last message."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._key = key
        self._last: tuple[bytes, str] | None = None
        # No message is lost to a slow subscriber; the hub waits a second for it.
        self._publisher = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )
        topic = topic_of(key)
        if topic is not None and topic.latched:
            callback = zenoh.handlers.Callback(self._on_query, indirect=False)
            self._queryable = session.declare_queryable(key, callback, complete=True)

    def put(self, payload: bytes, encoding: str) -> None:
        self._last = payload, encoding
        self._publisher.put(payload, encoding=encoding)

    def _on_query(self, query: zenoh.Query) -> None:
        zenoh_events.pin_thread_state()
        with query:
            if self._last is not None:
                payload, encoding = self._last
                query.reply(self._key, payload, encoding=encoding)


def _offers(keys: dict[str, str]) -> list[keyexpr.EndpointInfo]:
    """Return the endpoints for listings: the keys with known types."""
    found: list[keyexpr.EndpointInfo] = []
    for key, encoding in keys.items():
        topic: Any = topic_of(key)
        name, _, digest = encoding.removeprefix(codec.PREFIX).partition("#")
        if codec.is_typed(encoding) and name and digest and "/@" not in key:
            vehicle, hz = key.partition("/")[0], topic.hz if topic else 0.0
            found.append(keyexpr.EndpointInfo(vehicle, "@pub", NAME, name, digest, hz, key))
    return found


def _refuse_live(session: zenoh.Session, vehicle: str, keys: dict[str, str]) -> None:
    hint = "replay in another realm, e.g. with --realm replay"
    if "dynamics" in liveliness.nodes(session, vehicle):
        raise AlreadyServed(f"vehicle {vehicle} is live: a replay would be mistaken for it", hint)
    for offer in liveliness.offers(session, vehicle, "@pub"):
        if offer.key in keys:
            raise AlreadyServed(
                f"{offer.key} is published by {offer.node}: a replay would be mistaken for it",
                f"{hint}, or replay other keys only",
            )


_MOST_BYTES = 256 << 20
"""Bytes of payloads that may wait; beyond, messages are lost, and counted."""
_LATCHED = 60.0
"""Seconds that the answer with a latched message may take: nothing waits for it."""
_SETTLE = 0.5
"""Seconds in which the hub must send the rest at the end."""


class RawMessage(NamedTuple):
    """Message with its arrival time `at` and its sender's time `published`, both Unix ns."""

    key: str
    payload: bytes
    encoding: str
    at: int
    published: int


class RawListener:
    """Subscriber to keys or key expressions, of which none matches what another one does.

    The handler gets each message on a thread of Zenoh and must not block. There is no queue: after
    each pause of 10 ms the processor's caches are cold, and the shortest way costs least.
    """

    def __init__(
        self, session: zenoh.Session, keys: tuple[str, ...], handler: Callable[[RawMessage], None]
    ) -> None:
        self._session, self._handler = session, handler
        self._epoch = time.time_ns() - time.monotonic_ns()
        callback = zenoh.handlers.Callback(self._on_sample, indirect=False)
        self._subscribers = [session.declare_subscriber(key, callback) for key in keys]

    def request_latched(self, key: str) -> None:
        """Request the last message of a latched topic as well."""
        callback = zenoh.handlers.Callback(self._on_reply, indirect=False)
        self._session.get(key, callback, timeout=_LATCHED, **zenoh_events.ALL_SERVERS)

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if (sample := reply.ok) is not None:
            self._on_sample(sample)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        zenoh_events.pin_thread_state()
        at = self._epoch + time.monotonic_ns()
        payload, encoding = sample.payload.to_bytes(), str(sample.encoding)
        self._handler(RawMessage(str(sample.key_expr), payload, encoding, at, at))


class RecorderSubscriber:
    """Subscriber to keys or key expressions; a message that several of them match comes once.

    The constructor waits for the hub and raises TimedOut; later it survives the loss of a hub.
    Zenoh's thread only copies messages; `lost` counts those without room. Times are of one clock,
    which does not jump when the machine's clock is set.
    """

    def __init__(self, session: zenoh.Session, keys: tuple[str, ...]) -> None:
        self.lost = 0
        self._session, self._breaks = session, DisconnectListener(session)
        self._epoch = time.time_ns() - time.monotonic_ns()
        self._waiting: deque[RawMessage] = deque()
        # Each is counted by one thread only, so that no lock is needed.
        self._came = self._went = 0
        self._patterns = [zenoh.KeyExpr(key) for key in keys]
        self._subscribers = [
            session.declare_subscriber(
                pattern,
                zenoh.handlers.Callback(self._taker(self._patterns[:count]), indirect=False),
            )
            for count, pattern in enumerate(self._patterns)
        ]
        liveliness.nodes(session, "*")

    def request_latched(self, key: str) -> None:
        """Request the last messages of latched topics, if subscribed, as well."""
        callback = zenoh.handlers.Callback(self._on_reply, indirect=False)
        self._session.get(key, callback, timeout=_LATCHED, **zenoh_events.ALL_SERVERS)

    def has_held(self) -> bool:
        """Return whether the hub is connected and has been since the previous call."""
        return not self._breaks.fired() and bool(self._session.info.routers_zid())

    @property
    def waiting(self) -> int:
        """Return the number of messages not yet taken."""
        return len(self._waiting)

    def settle(self) -> None:
        """Wait until the hub has sent us everything, or does not answer."""
        with contextlib.suppress(TimedOut):
            liveliness.nodes(self._session, "*", _SETTLE)

    def take(self, most: int) -> list[RawMessage]:
        """Return the waiting messages in order of arrival, at most so many."""
        messages = [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]
        self._went += sum(len(message.payload) for message in messages)
        return messages

    def _taker(self, others: list[zenoh.KeyExpr]) -> Callable[[zenoh.Sample], None]:
        """Return a callback that drops the messages that one of the other patterns brings too."""

        def on_sample(sample: zenoh.Sample) -> None:
            zenoh_events.pin_thread_state()
            if not any(other.intersects(sample.key_expr) for other in others):
                self._put(sample)

        return on_sample

    def _on_reply(self, reply: zenoh.Reply) -> None:
        zenoh_events.pin_thread_state()
        sample = reply.ok
        if sample and any(pattern.intersects(sample.key_expr) for pattern in self._patterns):
            self._put(sample)

    def _put(self, sample: zenoh.Sample) -> None:
        if self._came - self._went > _MOST_BYTES:
            self.lost += 1
            return
        # Copied at once, as in a Subscription.
        payload, stamp = sample.payload.to_bytes(), sample.timestamp
        self._came += len(payload)
        at = self._epoch + time.monotonic_ns()
        published = at if stamp is None else round(stamp.get_time().timestamp() * 1e9)
        self._waiting.append(
            RawMessage(str(sample.key_expr), payload, str(sample.encoding), at, published)
        )
