"""The messages of one topic on their way from Zenoh's thread to a node's loop."""

import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Topic
from services.runtime import wire
from services.runtime.errors import Invalid

M = TypeVar("M", bound=Struct)

_log = logging.getLogger(__name__)


class Subscription(Generic[M]):
    """The newest message of a topic, and when it came.

    `value` is None until the first one; `received` is its arrival on the monotonic clock, s.
    Up to `depth` messages wait for the loop, the oldest are dropped beyond.
    """

    def __init__(
        self,
        topic: Topic[M],
        post: Callable[[Callable[[], None]], None],
        handler: Callable[[M], None] | None,
        depth: int,
    ) -> None:
        self.value: M | None = None
        self.received = 0.0
        self._topic, self._post, self._handler = topic, post, handler
        self._waiting: deque[tuple[float, bytes, str]] = deque(maxlen=depth)
        self._posted = False
        self._complaint = ""

    @property
    def age(self) -> float:
        """Seconds since the newest message came; infinite before the first."""
        return time.monotonic() - self.received if self.value is not None else float("inf")

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Zenoh's thread leaves a sample here, and posts to the inbox once until it is read."""
        self._waiting.append((time.monotonic(), sample.payload.to_bytes(), str(sample.encoding)))
        if not self._posted:
            self._posted = True
            self._post(self._drain)

    def _drain(self) -> None:
        self._posted = False
        while self._waiting:
            received, payload, said = self._waiting.popleft()
            try:
                value = wire.decode(self._topic.type, payload, said)
            except Invalid as error:
                self._complain(error)
                continue
            self.value, self.received = value, received
            if self._handler is not None:
                self._handler(value)

    def _complain(self, error: Invalid) -> None:
        # Said once per kind of fault: a stranger at 1 kHz must not fill the log.
        if error.message != self._complaint:
            self._complaint = error.message
            _log.warning("ignored a message on %s: %s", self._topic.name, error.message)
