"""A node: one process on the bus, with one loop that alone touches its state.

Zenoh's threads only post to the inbox. The loop serves it between ticks, so that a call is
answered on arrival and a handler never runs beside another.
"""

import logging
import math
import time
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import zenoh
from msgspec import Struct

from schemas.contract import Service, Topic
from schemas.describe import schema_hash
from services.runtime import foreign, graph, roster
from services.runtime.errors import AlreadyServed
from services.runtime.publisher import Publisher
from services.runtime.schedule import Schedule
from services.runtime.serving import Server
from services.runtime.subscription import Subscription

M = TypeVar("M", bound=Struct)
Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_DEPTH = 64
_LATE = 0.1
"""A loop that is later than this (s) drops the ticks it missed instead of hurrying after them."""


class Node:
    """What a service sees of the world: topics, services, ticks."""

    def __init__(
        self, name: str, vehicle: str, session: zenoh.Session, *, restarted: bool = False
    ) -> None:
        """`restarted` says that the supervisor started this process in a dead one's place.

        Raises AlreadyServed when another process is this node.
        """
        self.name, self.vehicle, self.restarted = name, vehicle, restarted
        self._others = roster.offers(session, vehicle)
        if name in roster.nodes(session, vehicle):
            raise AlreadyServed(f"another process already is the node {name} of {vehicle}")
        self.log = logging.getLogger(name)
        self._session = session
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._declared: list[Any] = []
        self._offers: list[Callable[[], graph.Offer]] = []
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self._subscriptions: list[Subscription[Any]] = []
        self._schedule = Schedule()
        self._ready = self._retimed = False
        self._waits = 0
        self.stopping = False
        self.on_params: Callable[[], None] | None = None

    def publisher(
        self, topic: Topic[M], hz: Callable[[], float] | None = None, *, waits: bool = False
    ) -> Publisher[M]:
        """Offer a topic, at its declared rate or at what `hz` says now and after each change.

        In lock-step, nothing of what it `waits` to publish is lost to a slow subscriber.
        """
        key, digest = topic.key(self.vehicle), schema_hash(topic.type)

        def offer() -> graph.Offer:
            rate = topic.hz if hz is None else hz()
            name = topic.type.__name__
            return graph.Offer("@pub", self.name, name, digest, rate, key)

        self._offers.append(offer)
        publisher = Publisher(self._session, key, topic, waits=waits)
        if topic.latched:
            self._answer_queries(key, publisher.answer)
        return publisher

    def listen(
        self, topic: Topic[M], handler: Callable[[M], None] | None = None, depth: int = _DEPTH
    ) -> Subscription[M]:
        """Hear a topic; the handler, where there is one, is called on the loop."""

        def awaited() -> bool:
            return self._waits > 0 or self._schedule.holding

        subscription = Subscription(topic, self._inbox.put, awaited, handler, depth)
        self._subscriptions.append(subscription)
        self._declared.append(
            self._session.declare_subscriber(
                topic.key(self.vehicle),
                zenoh.handlers.Callback(subscription.on_sample, indirect=False),
            )
        )
        return subscription

    def serve(self, service: Service[Q, R], handler: Callable[[Q], R]) -> Server[Q, R]:
        """Answer a service; the handler is called on the loop and may raise a QuadctlError.

        Raises AlreadyServed when another node answers it.
        """
        server = Server(self.vehicle, service, handler, self._schedule)
        for other in self._others:
            if other.key == server.key:
                raise AlreadyServed(f"{server.key} is already served by the node {other.node}")
        name, digest = service.type_name, schema_hash(service.request)
        offer = graph.Offer("@srv", self.name, name, digest, 0.0, server.key)
        self._offers.append(lambda: offer)
        self._answer_queries(server.key, server.answer)
        return server

    def clock(self, boot: str, stamp: float) -> None:
        """It is `stamp` (simulated s) of `boot`: the calls held for that time are executed now."""
        self._schedule.advance(boot, stamp, time.time())

    @property
    def in_mission(self) -> bool:
        """Whether calls are held for times of this boot.

        The flight is then to be the same whatever the machine's load: at any speed in lock-step.
        """
        return self._schedule.under_way

    def params_changed(self) -> None:
        """Tell the service, where it wants to know, that its parameters have new values."""
        if self.on_params is not None:
            self.on_params()
        self._retimed = True
        if self._ready:
            self._announce()

    def ready(self) -> None:
        """Announce the offers and then, last, the node: who sees it may already call it."""
        if self._ready:
            return
        self._ready = True
        self._announce()
        key = graph.node_key(self.vehicle, self.name)
        self._declared.append(self._session.liveliness().declare_token(key))

    def ticks(self, hz: float | Callable[[], float]) -> Iterator[float]:
        """Yield monotonic seconds at a rate, serving the inbox in between, until stopped.

        Ticks are counted, not added up, so none is lost to rounding. A callable rate is read
        at every tick and whenever parameters change: a new one counts from the last tick.
        """
        self.ready()
        rate_now = hz if callable(hz) else lambda: hz
        rate, start, count = rate_now(), time.monotonic(), 0
        last = start
        while self._serve_until(start + count / rate):
            now = time.monotonic()
            if rate_now() != rate:
                rate, start, count = rate_now(), last, 1
            elif now >= start + count / rate:
                self._catch_up()
                last = now
                yield now
                count += 1
                if time.monotonic() > start + count / rate + _LATE:
                    start, count = time.monotonic(), 1

    def spin(self) -> None:
        """Serve the inbox until stopped, for a node with no rhythm of its own."""
        self.ready()
        while self._serve_until(math.inf):
            pass

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Serve the inbox until the condition holds; False at the timeout (s) or when stopped."""
        deadline = time.monotonic() + timeout
        # Counted first: what comes between the two would wake nobody and not be seen.
        self._waits += 1
        self._catch_up()
        try:
            while not condition():
                if self.stopping or not self._serve_one(deadline):
                    return False
            return True
        finally:
            self._waits -= 1

    def stop(self) -> None:
        """End the loop soon; safe to call from a signal handler and from other threads."""
        self.stopping = True
        self._inbox.put(lambda: None)

    def _serve_until(self, deadline: float) -> bool:
        """Serve the inbox until a time on the monotonic clock; False when the node is stopped.

        Returns early when parameters change. What waits already is served even when the time has
        passed, and no more than that: a loop that is late still answers, and a flood does not
        hold up its ticks.
        """
        for _ in range(self._inbox.qsize()):
            self._inbox.get_nowait()()
        while not self.stopping and not self._retimed and self._serve_one(deadline):
            pass
        self._retimed = False
        return not self.stopping

    def _catch_up(self) -> None:
        for subscription in self._subscriptions:
            subscription.catch_up()

    def _serve_one(self, deadline: float) -> bool:
        left = deadline - time.monotonic()
        if left <= 0:
            return False
        try:
            # An untimed wait can miss a signal, so even an endless one looks up now and then.
            item = self._inbox.get(timeout=min(left, 0.5))
        except Empty:
            return True
        item()
        return True

    def _answer_queries(self, key: str, answer: Callable[[zenoh.Query], None]) -> None:
        def on_query(query: zenoh.Query) -> None:
            foreign.stay()
            self._inbox.put(lambda: on_turn(query))

        def on_turn(query: zenoh.Query) -> None:
            # What was said before the question counts in the answer.
            self._catch_up()
            answer(query)

        callback = zenoh.handlers.Callback(on_query, indirect=False)
        self._declared.append(self._session.declare_queryable(key, callback, complete=True))

    def _announce(self) -> None:
        # A token is replaced only where it says something new, so that nobody blinks.
        keys = {graph.offer_key(self.vehicle, offer()) for offer in self._offers}
        for key in self._tokens.keys() - keys:
            self._tokens.pop(key).undeclare()
        for key in keys - self._tokens.keys():
            self._tokens[key] = self._session.liveliness().declare_token(key)
