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
    """Plays the part of all who once published on some keys.

    The keys are listed as theirs were, and those of latched topics answer.
    """

    def __init__(self, session: zenoh.Session, keys: dict[str, str]) -> None:
        """`keys` has the encoding of each key. Raises AlreadyServed where somebody has one.

        A vehicle that is live has all of its keys.
        """
        vehicles = {key.partition("/")[0] for key in keys}
        for vehicle in sorted(vehicles):
            _refuse_beside_the_living(session, vehicle, keys)
        self._outlets = {key: _Outlet(session, key) for key in keys}
        tokens = [
            keyexpr.endpoint_key(key.partition("/")[0], offer) for key, offer in _offers(keys)
        ]
        # Last, as ever: who sees a node may already ask it.
        tokens += [keyexpr.node_key(vehicle, NAME) for vehicle in vehicles]
        self._tokens = [session.liveliness().declare_token(token) for token in tokens]

    def put(self, key: str, payload: bytes, encoding: str) -> None:
        """Say a message."""
        self._outlets[key].put(payload, encoding)


class _Outlet:
    """One key's end; what is latched answers with the last message."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._key = key
        self._last: tuple[bytes, str] | None = None
        # Nothing of a recording is lost to a slow subscriber; the hub waits a second for it.
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


def _offers(keys: dict[str, str]) -> list[tuple[str, keyexpr.EndpointInfo]]:
    """What listings shall show: the keys whose types are known."""
    found: list[tuple[str, keyexpr.EndpointInfo]] = []
    for key, said in keys.items():
        topic: Any = topic_of(key)
        name, _, digest = said.removeprefix(codec.PREFIX).partition("#")
        if codec.is_typed(said) and name and digest and "/@" not in key:
            hz = topic.hz if topic else 0.0
            found.append((key, keyexpr.EndpointInfo("@pub", NAME, name, digest, hz, key)))
    return found


def _refuse_beside_the_living(session: zenoh.Session, vehicle: str, keys: dict[str, str]) -> None:
    hint = "replay in a realm of its own, as with --realm replay"
    if "dynamics" in liveliness.nodes(session, vehicle):
        raise AlreadyServed(f"the vehicle {vehicle} is live: a replay would be taken for it", hint)
    for offer in liveliness.offers(session, vehicle):
        if offer.kind == "@pub" and offer.key in keys:
            raise AlreadyServed(
                f"{offer.key} is published by {offer.node}: a replay would be taken for it",
                f"{hint}, or name the keys to replay",
            )


_MOST_BYTES = 256 << 20
"""Payloads that may wait; beyond, what comes is lost, and counted."""
_SETTLE = 0.5
"""Seconds that the hub has to send the rest at the end."""


class RawMessage(NamedTuple):
    """A message as it came: `at` that Unix time, and `published` at that one by its sender, ns."""

    key: str
    payload: bytes
    encoding: str
    at: int
    published: int


class RecorderSubscriber:
    """Hears keys or key expressions from when it is made; a message once, however many match it.

    Zenoh's thread does no more than copy a message. `lost` counts those for which there was
    no room. Times are those of one clock, which does not jump when that of the machine is set.
    """

    def __init__(self, session: zenoh.Session, keys: tuple[str, ...]) -> None:
        """Returns once the hub knows of it; raises TimedOut where that does not answer."""
        self.lost = 0
        self._session, self._breaks = session, DisconnectListener(session)
        self._epoch = time.time_ns() - time.monotonic_ns()
        self._waiting: deque[RawMessage] = deque()
        # Each counted by one thread alone, so that nothing need be locked.
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

    def ask(self, key: str) -> None:
        """Have what latched topics hold come as well, where it is listened to."""
        callback = zenoh.handlers.Callback(self._on_reply, indirect=False)
        self._session.get(key, callback, timeout=1.0, **zenoh_events.ALL_SERVERS)

    def has_held(self) -> bool:
        """Whether the hub is there, and was so since this was last asked.

        One that is gone is waited for, and one that is back heard.
        """
        return not self._breaks.fired() and bool(self._session.info.routers_zid())

    @property
    def waiting(self) -> int:
        """How many messages have come that are not yet taken."""
        return len(self._waiting)

    def settle(self) -> None:
        """Return once all has come that the hub had for us; where it does not answer, at once."""
        with contextlib.suppress(TimedOut):
            liveliness.nodes(self._session, "*", _SETTLE)

    def take(self, most: int) -> list[RawMessage]:
        """The messages that wait, in the order in which they came, up to so many."""
        taken = [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]
        self._went += sum(len(message.payload) for message in taken)
        return taken

    def _taker(self, others: list[zenoh.KeyExpr]) -> Callable[[zenoh.Sample], None]:
        """What takes a message, unless one of the other patterns brings it too."""

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
