"""Subscribers to any keys, undecoded, and the queue of their messages; decoded for commands."""

import time
from collections.abc import Callable
from contextlib import suppress
from math import inf
from queue import Empty, SimpleQueue
from typing import Generic, NamedTuple, TypeVar

import zenoh
from msgspec import Struct

from quadctl.services.runtime.bus import codec, liveliness, zenoh_events
from quadctl.services.runtime.bus.session import is_forked
from quadctl.services.runtime.errors import Invalid, TimedOut

M = TypeVar("M", bound=Struct)


class RawMessage(NamedTuple):
    """Message with its arrival time `at` and its sender's time `published`, Unix ns; 0 if it has none."""

    key: str
    payload: bytes
    encoding: str
    at: int
    published: int

    @property
    def age(self) -> float | None:
        """Return the seconds between sending and arrival, by both clocks; None without a time stamp."""
        return (self.at - self.published) / 1e9 if self.published else None

    def decoded(self, type_: type[M]) -> M:
        """Return it as one of our types; raises Invalid if it is none."""
        return codec.decode(type_, self.payload, self.encoding)


class RawSubscriber:
    """Subscriber to keys or key expressions; a message that several of them match comes once.

    `take` gets each message on a thread of Zenoh and must not block, e.g. `put` of a MessageQueue.
    Times are of one clock, which does not jump when the machine's clock is set.
    """

    def __init__(
        self, session: zenoh.Session, keys: tuple[str, ...], take: Callable[[RawMessage], object]
    ) -> None:
        self._session, self._take = session, take
        self._epoch = time.time_ns() - time.monotonic_ns()
        self._silent: set[str] = set()
        self._patterns = [zenoh.KeyExpr(key) for key in keys]
        self._subscribers = [
            session.declare_subscriber(
                pattern,
                zenoh.handlers.Callback(self._taker(self._patterns[:count]), indirect=False),
            )
            for count, pattern in enumerate(self._patterns)
        ]

    def request_latched(self, key: str) -> None:
        """Request the last message of a latched topic as well, of each that an expression matches.

        One of a single key that came before is as new, and the reply is dropped.
        """
        if "*" not in key:
            self._silent.add(key)

        def on_reply(sample: zenoh.Sample) -> None:
            name = str(sample.key_expr)
            wanted = name in self._silent if "*" not in key else self._is_ours(sample.key_expr)
            if wanted:
                self._on_sample(sample)

        zenoh_events.request_latched(self._session, key, on_reply)

    def close(self) -> None:
        """End the subscriptions; messages that came before can still be read."""
        while self._subscribers and not is_forked():
            self._subscribers.pop().undeclare()

    def _is_ours(self, key: zenoh.KeyExpr) -> bool:
        return any(pattern.intersects(key) for pattern in self._patterns)

    def _taker(self, others: list[zenoh.KeyExpr]) -> Callable[[zenoh.Sample], None]:
        """Return a callback that drops the messages that one of the other patterns brings too."""
        if not others:
            return self._on_sample

        def on_sample(sample: zenoh.Sample) -> None:
            if not any(other.intersects(sample.key_expr) for other in others):
                self._on_sample(sample)

        return on_sample

    def _on_sample(self, sample: zenoh.Sample) -> None:
        zenoh_events.pin_thread_state()
        at, key, stamp = self._epoch + time.monotonic_ns(), str(sample.key_expr), sample.timestamp
        if self._silent:
            self._silent.discard(key)
        published = 0 if stamp is None else round(stamp.get_time().timestamp() * 1e9)
        # Copied at once: one in a million samples kept for later was overwritten by the next.
        payload = sample.payload.to_bytes()
        self._take(RawMessage(key, payload, str(sample.encoding), at, published))


_ROOM = 256 << 20
"""Bytes that may wait for a reader: with the longest messages far fewer than the backlog are kept."""


class MessageQueue:
    """Messages that wait for a reader: `backlog` of them at most, if there is room.

    Beyond, the oldest are dropped, with `keeps` the new ones; `lost` counts them.
    """

    def __init__(self, backlog: float = inf, *, keeps: bool = False) -> None:
        self._backlog, self._keeps = backlog, keeps
        self.lost = 0
        # Bytes that were queued, and bytes that were read: each is counted by one thread.
        self._queued = self._read = 0
        self._queue: SimpleQueue[RawMessage] = SimpleQueue()

    def put(self, message: RawMessage) -> None:
        """Add a message, on a thread of Zenoh."""
        size = len(message.payload)
        if self._keeps and self._queued + size - self._read > _ROOM and self.waiting:
            self.lost += 1
            return
        self._queued += size
        with suppress(Empty):  # the reader was faster
            while self.waiting >= self._backlog or self._queued - self._read > _ROOM:
                self._queued -= len(self._queue.get_nowait().payload)
                self.lost += 1
        self._queue.put(message)

    def next(self, timeout: float) -> RawMessage | None:
        """Return the next message, None if none comes within so many seconds."""
        try:
            message = self._queue.get(timeout=max(timeout, 0))
        except Empty:
            return None
        self._read += len(message.payload)
        return message

    @property
    def waiting(self) -> int:
        """Return the number of unread messages."""
        return self._queue.qsize()


class QueuedSubscriber(MessageQueue):
    """Subscriber with a queue of its own; see MessageQueue and RawSubscriber."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: tuple[str, ...],
        backlog: float = inf,
        *,
        keeps: bool = False,
    ) -> None:
        super().__init__(backlog, keeps=keeps)
        self._subscriber = RawSubscriber(session, keys, self.put)
        self.request_latched, self.close = self._subscriber.request_latched, self._subscriber.close


_SETTLE = 0.5
"""Seconds in which the hub must send the rest at the end."""


class RecorderSubscriber(QueuedSubscriber):
    """Subscriber that keeps every message, and knows whether its hub was there all the time.

    The constructor waits for the hub and raises TimedOut; later it survives the loss of a hub.
    """

    def __init__(self, session: zenoh.Session, keys: tuple[str, ...]) -> None:
        super().__init__(session, keys, keeps=True)
        self._session, self._breaks = session, zenoh_events.DisconnectListener(session)
        liveliness.nodes(session, "*")

    def has_held(self) -> bool:
        """Return whether the hub is connected and has been since the previous call."""
        return not self._breaks.fired() and bool(self._session.info.routers_zid())

    def settle(self) -> None:
        """Wait until the hub has sent us everything, or does not answer."""
        with suppress(TimedOut):
            liveliness.nodes(self._session, "*", _SETTLE)


class TypedSubscriber(Generic[M]):
    """Subscriber to topics; skips unreadable messages.

    `unread` has the errors of the topics whose newest message cannot be read, by key; those of
    messages on patterns are under "".
    """

    def __init__(self, stream: QueuedSubscriber, types: dict[str, type[M]]) -> None:
        self.unread: dict[str, Invalid] = {}
        self._stream, self._types = stream, types

    @property
    def problem(self) -> Invalid | None:
        """Return the error of the last message that cannot be read; None without any."""
        return next(reversed(self.unread.values()), None)

    @property
    def waiting(self) -> int:
        """Return the number of unread messages."""
        return self._stream.waiting

    @property
    def lost(self) -> int:
        """Return the number of messages that were dropped unread."""
        return self._stream.lost

    def close(self) -> None:
        """End the subscriptions; messages that came before can still be read."""
        self._stream.close()

    def next(self, timeout: float) -> M | None:
        """Return the next readable message, None if none comes within so many seconds."""
        deadline = time.monotonic() + timeout
        while (message := self._stream.next(deadline - time.monotonic())) is not None:
            try:
                found = self._decode(message)
            except Invalid as problem:
                key = message.key if message.key in self._types else ""
                self.unread.pop(key, None)
                self.unread[key] = codec.unreadable(message.key, problem)
                # A flood of nonsense on a key must not block its readers.
                if time.monotonic() > deadline:
                    break
            else:
                self.unread.pop(message.key, None)
                self.unread.pop("", None)
                return found
        return None

    def _decode(self, message: RawMessage) -> M:
        if message.key not in self._types:
            raise Invalid(f"it was published on the pattern {message.key}")
        return codec.decode(self._types[message.key], message.payload, message.encoding)
