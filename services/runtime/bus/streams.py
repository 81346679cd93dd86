"""Queues of received messages for commands, raw or decoded."""

import time
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Generic, NamedTuple, TypeVar

import zenoh
from msgspec import Struct

from quadctl.services.runtime.bus import codec, zenoh_events
from quadctl.services.runtime.bus.session import is_forked
from quadctl.services.runtime.errors import Invalid

M = TypeVar("M", bound=Struct)


class Message(NamedTuple):
    """Message of a key; `received` in monotonic s, `age` (s) by its time stamp, if it has one."""

    key: str
    payload: bytes
    encoding: str
    received: float
    age: float | None

    def decoded(self, type_: type[M]) -> M:
        """Return it as one of our types; raises Invalid if it is none."""
        return codec.decode(type_, self.payload, self.encoding)


_ROOM = 256 * 2**20
"""Bytes that may wait for a reader: with the longest messages far fewer than the backlog are kept."""


class RawSubscriber:
    """Subscriber to one key or several, undecoded; keeps the newest `backlog` messages, if there is room.

    `lost` counts the older ones that were dropped unread.
    """

    def __init__(self, session: zenoh.Session, keys: tuple[str, ...], backlog: int) -> None:
        self._backlog, self._silent = backlog, set(keys)
        self.lost = 0
        # Bytes that were queued, and bytes that were read: each is counted by one thread.
        self._queued = self._read = 0
        self._queue: SimpleQueue[Message] = SimpleQueue()
        callback = zenoh.handlers.Callback(self._on_sample, indirect=False)
        self._subscribers = [session.declare_subscriber(key, callback) for key in keys]

    def next(self, timeout: float) -> Message | None:
        """Return the next message, None if none comes within so many seconds."""
        try:
            message = self._queue.get(timeout=max(timeout, 0))
        except Empty:
            return None
        self._read += len(message.payload)
        return message

    def request_latched(self, session: zenoh.Session, key: str, timeout: float) -> None:
        """Request the last message of a latched topic, to come before all others of its key."""
        callback = zenoh.handlers.Callback(self._on_reply, indirect=False)
        session.get(key, callback, timeout=timeout, **zenoh_events.ALL_SERVERS)

    @property
    def waiting(self) -> int:
        """Return the number of unread messages."""
        return self._queue.qsize()

    def close(self) -> None:
        """End the subscriptions; messages that came before can still be read."""
        while self._subscribers and not is_forked():
            self._subscribers.pop().undeclare()

    def _on_reply(self, reply: zenoh.Reply) -> None:
        # A message that came before the reply is as new.
        if reply.ok is not None and str(reply.ok.key_expr) in self._silent:
            self._on_sample(reply.ok)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        zenoh_events.pin_thread_state()
        self._silent.discard(str(sample.key_expr))
        now, stamp = time.time(), sample.timestamp
        age = None if stamp is None else now - stamp.get_time().timestamp()
        payload = sample.payload.to_bytes()
        self._queued += len(payload)
        with suppress(Empty):  # the reader was faster
            while self._queue.qsize() >= self._backlog or self._queued - self._read > _ROOM:
                self._queued -= len(self._queue.get_nowait().payload)
                self.lost += 1
        self._queue.put(
            Message(str(sample.key_expr), payload, str(sample.encoding), time.monotonic(), age)
        )


class TypedSubscriber(Generic[M]):
    """Subscriber to topics; skips unreadable messages.

    `unread` has the errors of the topics whose newest message cannot be read, by key; those of
    messages on patterns are under "".
    """

    def __init__(self, stream: RawSubscriber, types: dict[str, type[M]]) -> None:
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

    def _decode(self, message: Message) -> M:
        if message.key not in self._types:
            raise Invalid(f"it was published on the pattern {message.key}")
        return codec.decode(self._types[message.key], message.payload, message.encoding)
