"""How many messages each node publishes, counted on its declared topics, now and then."""

import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import zenoh

from schemas.topics import TOPICS
from services.runtime.bus.session import address_of, open_client
from services.runtime.errors import Unreachable
from services.runtime.realm import Realm

if TYPE_CHECKING:
    _Ring = zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]

_MOST = 2_000
"""Messages of a topic counted at most; what comes beyond costs little, and is left out."""
_COUNT_FOR = 0.9
_COUNT_EVERY = 15.0
"""Seconds. To hear all messages all the time would cost more than all else that a supervisor does;
and no Python runs for each: they wait in a ring until looked at."""


class Rates:
    """Connects on a thread of its own, because the hub may be long in coming."""

    def __init__(self, realm: Realm, vehicles: Sequence[str]) -> None:
        self._realm = realm
        self._of = vehicles[0] if len(vehicles) == 1 else "*"
        self._session: zenoh.Session | None = None
        self._counting: list[tuple[str, _Ring]] = []
        self._began = -_COUNT_EVERY
        self._rates: dict[str, float] = {}
        self._closed = threading.Event()
        threading.Thread(target=self._connect, daemon=True).start()

    def look(self) -> dict[str, float]:
        """Messages per second of each node when last counted; call it about once a second."""
        passed = time.monotonic() - self._began
        if self._counting and passed >= _COUNT_FOR:
            self._rates = self._counted(passed)
        elif self._session is not None and passed >= _COUNT_EVERY:
            self._began = time.monotonic()
            self._counting = [
                (
                    topic.node,
                    self._session.declare_subscriber(key, zenoh.handlers.RingChannel(_MOST)),
                )
                for topic in TOPICS
                if topic.node and topic.hz and (key := topic.key(self._of))
            ]
        return self._rates

    def close(self) -> None:
        """Leave the bus."""
        self._closed.set()
        if self._session is not None:
            self._session.close()

    def _counted(self, passed: float) -> dict[str, float]:
        rates: dict[str, float] = {}
        for node, subscriber in self._counting:
            count = 0
            while subscriber.try_recv() is not None:
                count += 1
            subscriber.undeclare()
            rates[node] = rates.get(node, 0.0) + count / passed
        self._counting = []
        return rates

    def _connect(self) -> None:
        while not self._closed.is_set():
            try:
                self._session = open_client(address_of(self._realm), wait=5.0)
            except Unreachable:
                continue
            return
