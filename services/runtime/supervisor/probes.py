"""Probes over the bus: readiness, liveness and message rates."""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import zenoh

from quadctl.schemas import keyexpr
from quadctl.schemas.topics import POSE_SLOW, TOPICS, get_params
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.session import Address, address_of, close, open_client
from quadctl.services.runtime.errors import Unreachable
from quadctl.services.runtime.realm import Realm

if TYPE_CHECKING:
    _Ring = zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]

_MOST = 2_000
"""Messages of a topic that are counted at most; the ring drops further ones cheaply."""
_COUNT_FOR = 0.9
_COUNT_EVERY = 15.0
"""Seconds. Counting all the time would cost more than the rest of the supervisor. No Python runs
per message: messages wait in a ring until they are counted."""


class RateProbe:
    """Counter of message rates; a separate thread connects it, as the hub may start late."""

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
        """Return each node's last counted messages per second; call it about once a second."""
        passed = time.monotonic() - self._began
        if self._counting and passed >= _COUNT_FOR:
            self._rates = self._counted(passed)
        elif self._session is not None and passed >= _COUNT_EVERY:
            self._began, subscribe = time.monotonic(), self._session.declare_subscriber
            self._counting = [
                (topic.node, subscribe(topic.key(self._of), zenoh.handlers.RingChannel(_MOST)))
                for topic in TOPICS
                if topic.node and topic.hz and topic is not POSE_SLOW
            ]
        return self._rates

    def close(self) -> None:
        """Close the session."""
        self._closed.set()
        if self._session is not None:
            close(self._session)

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
        while self._session is None and not self._closed.is_set():
            with suppress(Unreachable):
                self._session = open_client(address_of(self._realm), wait=5.0)


Post = Callable[[Callable[[], None]], None]


class LivenessProbe:
    """Probe of readiness and liveness; a separate thread connects it, as the hub may start late.

    A process is ready when its nodes of all vehicles are. They share the process, so only the
    first vehicle's node is pinged. `on_ready(name)`, `on_answer(name)` and `on_progress(count)`, with
    the number of ready nodes, are posted to the loop.
    """

    def __init__(
        self,
        address: Address,
        vehicles: Sequence[str],
        post: Post,
        on_ready: Callable[[str], None],
        on_answer: Callable[[str], None],
        on_progress: Callable[[int], None],
    ) -> None:
        self._address, self._vehicles, self._post = address, frozenset(vehicles), post
        self._pinged, self._seen = vehicles[0], dict[str, set[str]]()
        self._on_ready, self._on_answer, self._on_progress = on_ready, on_answer, on_progress
        self._session: zenoh.Session | None = None
        self._tokens: zenoh.Subscriber[None] | None = None
        threading.Thread(target=self._connect, daemon=True).start()

    def ping(self, name: str, timeout: float) -> None:
        """Ping a node with an empty request; the error reply shows that its loop runs.

        It is the cheapest request: the node reads no parameter for it.
        """
        if self._session is None:
            return
        service = get_params(name)

        def on_reply(reply: zenoh.Reply) -> None:
            answered = reply.ok is not None or (
                reply.err is not None and str(reply.err.encoding) == codec.ERROR_ENCODING
            )
            if answered:
                self._post(lambda: self._on_answer(name))

        self._session.get(
            service.key(self._pinged),
            zenoh.handlers.Callback(on_reply, indirect=False),
            payload=b"",
            timeout=timeout,
        )

    def close(self) -> None:
        """Close the session."""
        if self._session is not None:
            close(self._session)

    def _connect(self) -> None:
        while self._session is None:
            try:
                session = open_client(self._address, wait=5.0)
            except Unreachable:
                continue
            self._tokens = session.liveliness().declare_subscriber(
                keyexpr.node_key("*", "*"),
                zenoh.handlers.Callback(self._on_token, indirect=False),
                history=True,
            )
            self._session = session

    def _on_token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        name, vehicle = keyexpr.node_of(key), keyexpr.vehicle_of(key)
        if name is None or vehicle not in self._vehicles:
            return
        seen = self._seen.setdefault(name, set())
        if sample.kind == zenoh.SampleKind.DELETE:
            seen.discard(vehicle)
            return
        seen.add(vehicle)
        count = sum(map(len, self._seen.values()))
        self._post(lambda: self._on_progress(count))
        if seen == self._vehicles:
            self._post(lambda: self._on_ready(name))
