"""Node side of a topic: Publisher and Subscription."""

import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

import zenoh
from msgspec import Struct

from quadctl.schemas.topics import Topic
from quadctl.services.runtime.bus import codec, zenoh_events
from quadctl.services.runtime.bus.zenoh_events import MatchingListener
from quadctl.services.runtime.errors import Invalid

M = TypeVar("M", bound=Struct)


class Publisher(Generic[M]):
    """Publishes one topic. A latched one also answers `get` with the last message.

    In real time what a slow subscriber has no room for is dropped. With `waits` it is waited for,
    up to the second that the hub gives it.
    """

    def __init__(
        self, session: zenoh.Session, key: str, topic: Topic[M], *, waits: bool = False
    ) -> None:
        self._key, self._encoding = key, codec.encoding(topic.type)
        control = zenoh.CongestionControl
        self._publisher = session.declare_publisher(
            key,
            encoding=self._encoding,
            congestion_control=control.BLOCK if waits else control.DROP,
        )
        self._listeners = MatchingListener(self._publisher)
        self._last = b""

    @property
    def is_heard(self) -> bool:
        """Whether the hub has told of a listener."""
        return self._listeners.is_there

    def put(self, message: M) -> None:
        """Publish a message; numbers must be Python's own, not numpy's."""
        self._last = codec.encode(message)
        self._publisher.put(self._last)

    def answer(self, query: zenoh.Query) -> None:
        """Reply with the last message, or with nothing before the first."""
        with query:
            if self._last:
                query.reply(self._key, self._last, encoding=self._encoding)


_FLOOD = 15_000
"""Messages a second (counted over _WINDOW, s) that are let gather before the loop sees them: if the
two threads took turns for each, that would cost several times what the message itself does."""
_WINDOW = 0.002
_GATHER = 0.0004
"""For so long (s); at 100 000 a second fewer come than may wait."""
_NEWEST = 64
"""Kept where the newest alone is wanted: it may be the one that cannot be read."""

_log = logging.getLogger(__name__)


class Subscription(Generic[M]):
    """The newest message of a topic, and when it came.

    `value` is None until the first one; `received` is its arrival on the monotonic clock, s.
    Up to `depth` messages wait for the handler, the oldest are dropped beyond. Without a handler
    messages wake nobody: the newest is decoded when it is asked for.
    """

    def __init__(
        self,
        topic: Topic[M],
        post: Callable[[Callable[[], None]], None],
        run_inline: Callable[[Callable[[], None]], None],
        awaited: Callable[[], bool],
        handler: Callable[[M], None] | None,
        depth: int,
    ) -> None:
        """`post` puts into the loop's inbox, and `run_inline` does so where it must.

        `awaited` says that the loop waits for a change.
        """
        self._value: M | None = None
        self._received = 0.0
        self._topic, self._post, self._awaited, self._handler = topic, post, awaited, handler
        self._run_inline = run_inline
        self._waiting: deque[tuple[float, bytes, str]] = deque(
            maxlen=_NEWEST if handler is None else depth
        )
        self._posted = False
        self._since, self._count, self._flood = 0.0, 0, False
        self._rests_until = 0.0 if handler is not None else float("inf")
        self._complaint = ""
        self._ours = codec.encoding(topic.type)
        # Made here, not kept of a sample: that would be written over with it.
        self._expected = zenoh.Encoding(self._ours)

    @property
    def value(self) -> M | None:
        """The newest message; in a handler's topic, the one last handed to it."""
        self._look()
        return self._value

    @property
    def received(self) -> float:
        """When `value` came, monotonic s."""
        self._look()
        return self._received

    @property
    def age(self) -> float:
        """Seconds since the newest message came; infinite before the first."""
        return time.monotonic() - self.received if self.value is not None else float("inf")

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Zenoh's thread leaves a sample here, and posts to the inbox once until it is read."""
        zenoh_events.pin_thread_state()
        now, encoding = time.monotonic(), sample.encoding
        # As a rule it is ours, and to see that takes half the time of writing it out.
        said = self._ours if encoding == self._expected else str(encoding)
        # Copied at once: a sample kept for later was seen, once in a million, to have been written
        # over by what came next.
        self._waiting.append((now, sample.payload.to_bytes(), said))
        self._count += 1
        if (passed := now - self._since) > _WINDOW:
            self._flood = self._count > _FLOOD * passed
            self._since, self._count = now, 0
        if not self._posted and (now >= self._rests_until or self._awaited()):
            self._posted = True
            (self._post if self._flood else self._run_inline)(self.poll)

    def defer_wakeups(self, seconds: float) -> None:
        """Let what comes within so many seconds wait for what comes next, a call or a tick."""
        self._rests_until = time.monotonic() + seconds

    def poll(self) -> None:
        """Hand what waits to the handler, and no more than that: a flood must not hold the loop."""
        self._posted = False
        if self._handler is None:
            return
        count = len(self._waiting)
        if not count:
            # So it is at nearly every tick, after 10 ms in which others had the processor's caches.
            return
        for _ in range(count):
            # A handler that serves the inbox meanwhile has taken them itself.
            if self._waiting and self._take(*self._waiting.popleft()) and self._value is not None:
                self._handler(self._value)
        if self._flood:
            self._posted = True
            self._post(self._gather)

    def _gather(self) -> None:
        time.sleep(_GATHER)
        self.poll()

    def _look(self) -> None:
        if self._handler is None and self._waiting:
            # Zenoh's thread adds on the right meanwhile, and may push out what is oldest.
            arrived = [self._waiting.popleft() for _ in range(len(self._waiting))]
            any(self._take(*arrival) for arrival in reversed(arrived))

    def _take(self, received: float, payload: bytes, said: str) -> bool:
        type_ = self._topic.type
        try:
            if said != self._ours:
                codec.check_schema(type_, said)
            self._value = codec.decode_fields(type_, payload)
        except Invalid as error:
            # Said once per kind of fault: a stranger at 1 kHz must not fill the log.
            if error.message != self._complaint:
                self._complaint = error.message
                _log.warning("ignored a message on %s: %s", self._topic.name, error.message)
            return False
        self._received = received
        return True
