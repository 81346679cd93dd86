"""Node side of a topic: Publisher and Subscription."""

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, Generic, TypeVar

import zenoh
from msgspec import Struct

from quadctl.schemas.topics import Topic
from quadctl.services.runtime.bus import codec, zenoh_events
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.executor import Outbox
from quadctl.services.runtime.typed import require

M = TypeVar("M", bound=Struct)


_MOST = 128
"""Messages of a bundle, some 30 kB: Zenoh sends more than 64 kB in pieces."""


class Bundle:
    """Messages of one topic, of several vehicles, that wait to go out together."""

    def __init__(self, session: zenoh.Session, key: str, encoding: str, outbox: Outbox) -> None:
        """Declare the key; messages go out when the outbox is flushed."""
        self._publisher = session.declare_publisher(
            key, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
        )
        self._matches = zenoh_events.MatchingListener(self._publisher)
        self._waiting: deque[tuple[str, Struct, int]] = deque()
        self._outbox, self._process = outbox, int.from_bytes(os.urandom(4))
        self._is_due = False
        """True once the outbox has a call that sends what is added from now on."""
        self.beats, self._sent = 0, 0
        """Beats of the process, and those that were sent."""

    def add(self, vehicle: str, message: Struct, rest: int) -> None:
        """Add a vehicle's message, if there is a process to take it; safe to call from any thread."""
        if self.is_received:
            self._waiting.append((vehicle, message, rest))
            self._send_later()

    @property
    def is_received(self) -> bool:
        """Return whether the hub has reported a process that takes the bundle."""
        return self._matches.was_there

    def beat(self) -> None:
        """Count a beat: each vehicle at rest repeats its message."""
        self.beats += 1
        self._send_later()

    def _send_later(self) -> None:
        if not self._is_due:
            self._is_due = True
            self._outbox.add(self._send)

    def _send(self) -> None:
        self._is_due = False
        while self._waiting or self._sent != self.beats:
            count, self._sent = min(len(self._waiting), _MOST), self.beats
            some = [self._waiting.popleft() for _ in range(count)]
            self._publisher.put(codec.encode((self._process, self._sent, some)))


class BundlePart:
    """Vehicle's part of a bundle."""

    def __init__(self, bundle: Bundle, vehicle: str) -> None:
        self._bundle, self._vehicle = bundle, vehicle
        self.beat = bundle.beat

    def add(self, message: Struct, rest: int) -> None:
        """Add a message, which with a `rest` above 0 the vehicle repeats from now on."""
        self._bundle.add(self._vehicle, message, rest)

    @property
    def is_received(self) -> bool:
        """Return whether the hub has reported a process that takes the bundle."""
        return self._bundle.is_received

    @property
    def beats(self) -> int:
        """Return how many beats the process has counted."""
        return self._bundle.beats


class Publisher(Generic[M]):
    """Publisher of one topic; a latched one also answers `get` with the last message.

    A subscriber without room loses the message; with `waits`, `put` blocks for it, 1 s at most.
    `defer`, if any, sends a message later. What is `part` of a bundle goes out alone, too, only while somebody subscribes.
    `on_match` is called, on a Zenoh thread, when subscribers come or all have gone.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        topic: Topic[M],
        *,
        waits: bool = False,
        defer: Callable[[Callable[[], None]], None] | None = None,
        part: BundlePart | None = None,
        on_match: Callable[[], None] = lambda: None,
    ) -> None:
        self._key, self._type = key, topic.type
        self._encoding = codec.encoding(topic.type)
        control = zenoh.CongestionControl
        self._publisher = session.declare_publisher(
            key,
            encoding=self._encoding,
            congestion_control=control.BLOCK if waits else control.DROP,
        )
        self._defer, self.part = defer, part
        self._matches = zenoh_events.MatchingListener(self._publisher, on_match)
        self._last = b""

    @property
    def last(self) -> M | None:
        """Return the last message, None before the first."""
        return codec.decode_fields(self._type, self._last) if self._last else None

    @property
    def has_subscribers(self) -> bool:
        """Return whether the hub has reported a subscriber."""
        return self._matches.was_there

    def put(self, message: M, rest: int = 0) -> None:
        """Publish a message; numbers must be Python's own, not numpy's, else it raises Invalid.

        `rest`, in a bundle: until its next message, the vehicle repeats this one, with a number that
        grows by so much a period. It counts the bundle's beats, and need not send them.
        """
        if not isinstance(message, self._type):
            require(message, self._type, f"{self._type.__name__}(...)")
        if self.part is not None:
            self.part.add(message, rest)
            if not self.has_subscribers:
                return
        try:
            self._last = payload = codec.encode(message)
        except (TypeError, OverflowError, UnicodeEncodeError, RecursionError) as error:
            hint = "give plain numbers, texts, lists and tables: float(x) of a NumPy number"
            raise Invalid(f"a message on {self._key} cannot be sent: {error}", hint) from error
        if self._defer is None:
            self._publisher.put(payload)
        else:
            self._defer(partial(self._publisher.put, payload))

    def answer(self, query: zenoh.Query) -> None:
        """Reply with the last message, or with nothing before the first."""
        with query:
            if self._last:
                query.reply(self._key, self._last, encoding=self._encoding)


_FLOOD = 15_000
"""Messages a second, counted over _WINDOW (s), above which the loop takes them in batches: a switch
of threads for each would cost several times the message itself."""
_WINDOW = 0.002
_GATHER = 0.0004
"""Seconds of a batch; at 100 000 messages a second fewer come than may wait."""
_NEWEST = 64
"""Messages kept without a handler, which needs only the newest readable one."""

_log = logging.getLogger(__name__)
_counting = threading.Lock()


class Beats:
    """Periods that a process counts for its vehicles at rest, and when it sent anything last, monotonic s."""

    __slots__ = ("count", "received")

    def __init__(self) -> None:
        self.count, self.received = 0, 0.0


Again = Callable[[Any, int], Any]
"""Returns a message as it is so many periods later."""


class Subscription(Generic[M]):
    """Newest message of a topic and its arrival time.

    `value` is None until the first one; `received` is its arrival on the monotonic clock, s.
    Up to `depth` messages wait for the handler; beyond, the oldest are dropped, which is logged once,
    with their number, when there is room again. Unless the topic
    `wakes` the loop, or it has `awaited` a message, the handler runs at the next call or tick.
    Without a handler the newest message is decoded on access. If it `skips`, the messages that a vehicle
    at rest repeats are taken as one, before the next call, tick or other message.
    """

    def __init__(
        self,
        topic: Topic[M],
        post: Callable[[Callable[[], None]], None],
        run_inline: Callable[[Callable[[], None]], None],
        awaited: Callable[[], bool],
        handler: Callable[[M], None] | None,
        depth: int,
        *,
        wakes: bool,
        skips: bool = False,
    ) -> None:
        self._value: M | None = None
        self._received = 0.0
        self._topic, self._post, self._awaited, self._handler = topic, post, awaited, handler
        self._run_inline = run_inline
        self._depth = _NEWEST if handler is None else depth
        self._waiting: deque[tuple[float, Any, str]] = deque(maxlen=self._depth)
        self._posted = False
        self._since, self._count, self._flood = 0.0, 0, False
        self._wakes = wakes and handler is not None
        self.skips, self.may_wake = skips, wakes
        self.pull: Callable[[], None] | None = None
        """Takes what has come and was not taken yet."""
        self.beats: Beats | None = None
        """Count of the periods for which the newest message holds, None if it is not repeated."""
        self._counted = 0
        self._resting: M
        self._again: Again
        self._complaint = ""
        self._dropped, self._drops_logged = 0, False
        self._ours = codec.encoding(topic.type)
        # Not taken from a sample: it would be overwritten with the sample.
        self._expected = zenoh.Encoding(self._ours)

    @property
    def value(self) -> M | None:
        """Return the newest message; with a handler, the one last passed to it."""
        self._look()
        return self._value

    @property
    def received(self) -> float:
        """Return when `value` came, monotonic s."""
        self._look()
        return self._received

    @property
    def age(self) -> float:
        """Return the seconds since the newest message came; infinite before the first."""
        return time.monotonic() - self.received if self.value is not None else float("inf")

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Take a sample, on a Zenoh thread."""
        zenoh_events.pin_thread_state()
        encoding = sample.encoding
        # Usually it is ours, and this comparison takes half the time of str().
        name = self._ours if encoding == self._expected else str(encoding)
        # Copied at once: one in a million samples kept for later was overwritten by the next.
        self.take(time.monotonic(), sample.payload.to_bytes(), name)

    def take(self, now: float, payload: bytes | M, encoding: str) -> None:
        """Queue a message that came `now` (monotonic s), and post `poll` to the loop once until it runs.

        A message that is decoded already has no encoding.
        """
        if self.beats is not None:
            self._sum_up()
            self.beats = None
        if self._wakes and not (self._waiting or isinstance(payload, bytes)):
            # Of a bundle: it wakes its loop in any case, and floods none.
            self._run_inline(partial(self._handle, now, payload))
            return
        self._queue(now, payload, encoding)
        self._count += 1
        if (passed := now - self._since) > _WINDOW:
            self._flood = self._count > _FLOOD * passed
            self._since, self._count = now, 0
        self._wake()

    def take_rest(self, now: float, message: M, beats: Beats, count: int, again: Again) -> None:
        """Take a message of a beat, by its count, which the vehicle repeats at each further one.

        If messages are skipped, the newest beat does not count yet: the vehicle may have moved at it.
        """
        self._sum_up()
        with _counting:
            self.beats, self._counted = beats, count + self.skips
            self._resting, self._again = message, again
        self._queue(now, message, "")
        self._wake()

    def take_beat(self) -> None:
        """Queue what the newest beat repeats, if anything, as a message of its own."""
        if self.beats is not None:
            self._sum_up()
            self._wake()

    def _sum_up(self) -> None:
        with _counting:
            beats = self.beats
            if beats is not None and (times := beats.count - self._counted) > 0:
                self._counted = beats.count
                self._resting = self._again(self._resting, times)
                self._queue(beats.received, self._resting, "")

    def _queue(self, now: float, payload: bytes | M, encoding: str) -> None:
        if len(self._waiting) == self._depth:
            self._dropped += 1
        self._waiting.append((now, payload, encoding))

    def _wake(self) -> None:
        if not self._posted and self.is_awaited:
            self._posted = True
            (self._post if self._flood else self._run_inline)(self.poll)

    @property
    def is_awaited(self) -> bool:
        """Return whether a message is to wake the loop."""
        return self._wakes or self._awaited()

    def on_latched(self, sample: zenoh.Sample) -> None:
        """Queue the last message of a latched topic; one that came before is as new."""
        if not self._since:
            self.on_sample(sample)

    def poll(self) -> None:
        """Pass the messages waiting now to the handler, not later ones: a flood must not block."""
        self._posted = False
        self._catch_up()
        if self._handler is None:
            return
        count = len(self._waiting)
        if not count:  # as at nearly every tick, when the processor's caches are cold
            if self._dropped and not self._drops_logged:
                self._log_drops()
            return
        # Looked up once: of a flood 100 000 messages a second pass here.
        decode, ours = codec.decoder(self._topic.type).decode, self._ours
        waiting = self._waiting
        for _ in range(count):
            if not waiting:  # a handler that itself serves the loop's queue has already taken them
                break
            received, payload, encoding = waiting.popleft()
            try:
                value = decode(payload) if encoding is ours else self._read(payload, encoding)
            except codec.UNREADABLE:
                value = self._read(payload, encoding)
            if value is not None:
                self._handle(received, value)
        if self._flood:
            self._posted = True
            self._post(self._gather)

    def _handle(self, received: float, message: M) -> None:
        self._value, self._received = message, received
        if self._handler is not None:
            self._handler(message)

    def _log_drops(self) -> None:
        self._drops_logged = True
        _log.warning(
            "%s: %d messages came faster than they were handled and were dropped; the newest %d wait",
            self._topic.name, self._dropped, self._depth,
        )  # fmt: skip

    def _gather(self) -> None:
        time.sleep(_GATHER)
        self.poll()

    def _catch_up(self) -> None:
        if self.pull is not None:
            self.pull()
        if self.beats is not None:
            self._sum_up()

    def _look(self) -> None:
        if self._handler is not None:
            return
        self._catch_up()
        if self._waiting:
            # Zenoh's thread appends at the same time, and may push out the oldest.
            arrived = [self._waiting.popleft() for _ in range(len(self._waiting))]
            for received, payload, encoding in reversed(arrived):
                if (value := self._read(payload, encoding)) is not None:
                    self._value, self._received = value, received
                    break

    def _read(self, payload: bytes | M, encoding: str) -> M | None:
        """Return a message of any sender; None for one that is refused, which is logged."""
        if not isinstance(payload, bytes):
            return payload
        type_ = self._topic.type
        try:
            codec.check_schema(type_, encoding)
            return codec.decode_fields(type_, payload)
        except Invalid as error:
            # Logged once per kind of fault: a foreign publisher at 1 kHz must not fill the log.
            if error.message != self._complaint:
                self._complaint = error.message
                _log.warning("ignored a message on %s: %s", self._topic.name, error.message)
            return None
