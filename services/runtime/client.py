"""A command's way onto the bus: connects at once or fails at once, and never hangs."""

import time
from queue import Empty, SimpleQueue
from typing import NamedTuple, Self, TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Service, Topic
from services.runtime import graph, roster, wire
from services.runtime.calls import Caller
from services.runtime.errors import TimedOut, Unreachable
from services.runtime.realm import Realm
from services.runtime.record import is_live, not_running
from services.runtime.session import address_of, open_client

M = TypeVar("M", bound=Struct)
Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_BACKLOG = 10_000
"""Messages kept for a slow reader; the oldest go first beyond."""


class Message(NamedTuple):
    """What came on a key."""

    key: str
    payload: bytes
    encoding: str


class Stream:
    """Messages as they come, of one key or several."""

    def __init__(self, session: zenoh.Session, keys: tuple[str, ...]) -> None:
        self._queue: SimpleQueue[Message] = SimpleQueue()
        callback = zenoh.handlers.Callback(self._on_sample, indirect=False)
        self._subscribers = [session.declare_subscriber(key, callback) for key in keys]

    def next(self, timeout: float) -> Message | None:
        """The next message, None when none comes within so many seconds."""
        try:
            return self._queue.get(timeout=max(timeout, 0))
        except Empty:
            return None

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if self._queue.qsize() >= _BACKLOG:
            self._queue.get_nowait()
        self._queue.put(
            Message(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding))
        )


class Client:
    """One connection to a realm's hub, for as long as a `with` block lasts."""

    def __init__(
        self, realm: str, vehicle: str, *, connect: str = "", timeout: float = 3.0
    ) -> None:
        """`timeout` (s) bounds every reply. Raises Unreachable when no hub is there."""
        self.vehicle, self.timeout = vehicle, timeout
        self._session = _connect(Realm(realm), connect, timeout)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def call(self, service: Service[Q, R], request: Q) -> R:
        """Call a service once; raises Unreachable, TimedOut or what the server replied."""
        return Caller(self._session, self.vehicle, service).call(request, self.timeout)

    def latest(self, topic: Topic[M]) -> M:
        """The last message of a latched topic."""
        key = topic.key(self.vehicle)
        deadline = time.monotonic() + self.timeout
        while (left := deadline - time.monotonic()) > 0:
            for reply in self._session.get(key, timeout=left):
                if reply.ok is not None:
                    sample = reply.ok
                    return wire.decode(topic.type, sample.payload.to_bytes(), str(sample.encoding))
                raise TimedOut(
                    f"{topic.node} did not answer within {self.timeout:g} s",
                    "its process is busy or frozen: `quadctl status` shows which",
                )
            # Nobody answers for the key yet; a restart takes a tenth of a second.
            time.sleep(min(left, 0.02))
        raise Unreachable(
            f"nobody answered for {key} within {self.timeout:g} s",
            f"is {topic.node} up? `quadctl status` shows it",
        )

    def first(self, topic: Topic[M]) -> M:
        """The next message of a topic."""
        message = self.listen(topic.key(self.vehicle)).next(self.timeout)
        if message is None:
            raise self.silent(topic.key(self.vehicle))
        return wire.decode(topic.type, message.payload, message.encoding)

    def listen(self, *keys: str) -> Stream:
        """Hear keys or key expressions."""
        return Stream(self._session, keys)

    def silent(self, key: str) -> TimedOut | Unreachable:
        """Why nothing came on a key: its publisher is quiet, or there is none."""
        for offer in self.offers():
            if offer.kind == "@pub" and offer.key == key:
                return TimedOut(
                    f"nothing came on {key} within {self.timeout:g} s, although {offer.node}"
                    " publishes it",
                    "its process is busy, frozen, or waits for another: `quadctl status`",
                )
        return Unreachable(
            f"nothing came on {key} within {self.timeout:g} s: nobody publishes it",
            "`quadctl topic list` shows what there is",
        )

    def nodes(self) -> list[str]:
        """The ready nodes."""
        return roster.nodes(self._session, self.vehicle)

    def offers(self) -> list[graph.Offer]:
        """The topics and services of the ready nodes."""
        return roster.offers(self._session, self.vehicle)


def _connect(realm: Realm, connect: str, timeout: float) -> zenoh.Session:
    """Connect at once, or fail at once; only a hub that is being restarted is waited for."""
    address, began = address_of(realm, connect), time.monotonic()
    try:
        return open_client(address, timeout=timeout)
    except Unreachable:
        if connect:
            raise
        if not is_live(realm):
            raise not_running(realm) from None
        left = timeout - (time.monotonic() - began)
        if left <= 0:
            raise
        return open_client(address, wait=left, timeout=left)
