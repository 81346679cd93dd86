"""The sending end of a topic."""

from typing import Generic, TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Topic
from services.runtime.bus import wire
from services.runtime.bus.matching import Matching

M = TypeVar("M", bound=Struct)


class Publisher(Generic[M]):
    """Publishes one topic. A latched one also answers `get` with the last message.

    In real time what a slow subscriber has no room for is dropped. With `waits` it is waited for,
    up to the second that the hub gives it.
    """

    def __init__(
        self, session: zenoh.Session, key: str, topic: Topic[M], *, waits: bool = False
    ) -> None:
        self._key, self._encoding = key, wire.encoding(topic.type)
        control = zenoh.CongestionControl
        self._publisher = session.declare_publisher(
            key,
            encoding=self._encoding,
            congestion_control=control.BLOCK if waits else control.DROP,
        )
        self._listeners = Matching(self._publisher)
        self._last = b""

    @property
    def is_heard(self) -> bool:
        """Whether the hub has told of a listener."""
        return self._listeners.is_there

    def put(self, message: M) -> None:
        """Publish a message; numbers must be Python's own, not numpy's."""
        self._last = wire.encode(message)
        self._publisher.put(self._last)

    def answer(self, query: zenoh.Query) -> None:
        """Reply with the last message, or with nothing before the first."""
        with query:
            if self._last:
                query.reply(self._key, self._last, encoding=self._encoding)
