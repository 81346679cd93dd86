"""Node: a service of one vehicle on the bus, with one loop for all its handlers."""

import logging
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import zenoh
from msgspec import Struct

from quadctl.schemas import keyexpr
from quadctl.schemas.params import Params
from quadctl.schemas.topics import Service, Topic
from quadctl.services.runtime.bus import codec, liveliness, zenoh_events
from quadctl.services.runtime.bus.pubsub import Publisher, Subscription
from quadctl.services.runtime.bus.raw import RecorderSubscriber
from quadctl.services.runtime.errors import AlreadyServed
from quadctl.services.runtime.executor import Executor
from quadctl.services.runtime.server import CallLog, Schedule, Server

M = TypeVar("M", bound=Struct)
Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_DEPTH = 1000
"""Messages that may wait for a handler: a hundredth of a second of a flood."""


class Node:
    """What a service sees of the world: topics, services, ticks."""

    def __init__(
        self,
        name: str,
        vehicle: str,
        session: zenoh.Session,
        executor: Executor | None = None,
        *,
        restarted: bool = False,
        reference_params: Params | None = None,
        single: bool = True,
    ) -> None:
        """`restarted` says that the supervisor started this process in a dead one's place.

        `reference_params` are those of a process's first vehicle, where this is another; `single` says
        that it has no other.

        Raises AlreadyServed when another process is this node.
        """
        self.name, self.vehicle, self.restarted = name, vehicle, restarted
        self.reference_params, self.single = reference_params, single
        self._others = liveliness.offers(session, vehicle)
        if name in liveliness.nodes(session, vehicle):
            raise AlreadyServed(f"another process already is the node {name} of {vehicle}")
        log = logging.getLogger(name)
        self.log = log if single else _Of(vehicle, log)
        self._session = session
        self.executor = executor or Executor()
        self._declared: list[Any] = []
        self._offers: list[Callable[[], keyexpr.EndpointInfo]] = []
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self._schedule = Schedule()
        self._ready = False
        self.on_params: Callable[[], None] | None = None
        self.in_force: Callable[[], dict[str, Any]] = dict

    def publisher(
        self, topic: Topic[M], hz: Callable[[], float] | None = None, *, waits: bool = False
    ) -> Publisher[M]:
        """Offer a topic, at its declared rate or at what `hz` says now and after each change.

        In lock-step, nothing of what it `waits` to publish is lost to a slow subscriber.
        """
        key, digest = topic.key(self.vehicle), codec.digest(topic.type)

        def offer() -> keyexpr.EndpointInfo:
            rate = topic.hz if hz is None else hz()
            name = topic.type.__name__
            return keyexpr.EndpointInfo("@pub", self.name, name, digest, rate, key)

        self._offers.append(offer)
        publisher = Publisher(self._session, key, topic, waits=waits)
        if topic.latched:
            self._answer_queries(key, publisher.answer)
        return publisher

    def listen(
        self,
        topic: Topic[M],
        handler: Callable[[M], None] | None = None,
        depth: int = _DEPTH,
        *,
        inline: bool = False,
    ) -> Subscription[M]:
        """Hear a topic; the handler, where there is one, is called on the loop's turn.

        With `inline` it is called sooner, as it may be that waits for nothing.
        """

        def awaited() -> bool:
            return self.executor.waits > 0 or self._schedule.holding

        post = self.executor.post
        now = self.executor.run_inline if inline else post
        subscription = Subscription(topic, post, now, awaited, handler, depth)
        self.executor.add_poller(subscription.poll)
        self._declared.append(
            self._session.declare_subscriber(
                topic.key(self.vehicle),
                zenoh.handlers.Callback(subscription.on_sample, indirect=False),
            )
        )
        return subscription

    def tap(self, keys: tuple[str, ...]) -> RecorderSubscriber:
        """Hear all that comes on keys or key expressions, undecoded."""
        return RecorderSubscriber(self._session, keys)

    def serve(
        self, service: Service[Q, R], handler: Callable[[Q], R], *, inline: bool = False
    ) -> Server[Q, R]:
        """Answer a service; the handler is called on the loop's turn and may raise a QuadctlError.

        With `inline` it is called sooner, as it may be that waits for nothing.

        Raises AlreadyServed when another node answers it.
        """
        journal = None
        if not service.reads:
            journal = CallLog(self._session, self.vehicle, service, self._schedule)
        server = Server(self.vehicle, service, handler, self._schedule, journal)
        for other in self._others:
            if other.key == server.key:
                raise AlreadyServed(f"{server.key} is already served by the node {other.node}")
        name, digest = service.type_name, codec.digest(service.request)
        offer = keyexpr.EndpointInfo("@srv", self.name, name, digest, 0.0, server.key)
        self._offers.append(lambda: offer)
        self._answer_queries(server.key, server.answer, inline=inline)
        return server

    def advance_sim_time(self, boot: str, stamp: float) -> None:
        """It is `stamp` (simulated s) of `boot`: the calls held for that time are executed now."""
        self._schedule.advance(boot, stamp, time.time())

    @property
    def is_first(self) -> bool:
        """Whether this is the node of its process's first vehicle."""
        return self.reference_params is None

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
        self.executor.retime()
        if self._ready:
            self._announce()

    def params_in_force(self) -> dict[str, Any]:
        """Return what still holds, by name, of parameters that wait for a standstill."""
        return self.in_force()

    def ready(self) -> None:
        """Announce the offers and then, last, the node: who sees it may already call it."""
        if self._ready:
            return
        self._ready = True
        self._announce()
        key = keyexpr.node_key(self.vehicle, self.name)
        self._declared.append(self._session.liveliness().declare_token(key))

    def ticks(self, hz: float | Callable[[], float]) -> Iterator[float]:
        """Announce the node; then as Executor.ticks, at a rate that parameters may change."""
        self.ready()
        return self.executor.ticks(hz)

    def spin(self) -> None:
        """Serve the inbox until stopped, for a node with no rhythm of its own."""
        self.ready()
        self.executor.spin()

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Serve the inbox until the condition holds; False at the timeout (s) or when stopped."""
        return self.executor.wait_for(condition, timeout)

    @property
    def stopping(self) -> bool:
        """Whether the loop is to end."""
        return self.executor.stopping

    def _answer_queries(
        self, key: str, answer: Callable[[zenoh.Query], None], *, inline: bool = False
    ) -> None:
        take = self.executor.run_inline if inline else self.executor.post

        def on_query(query: zenoh.Query) -> None:
            zenoh_events.pin_thread_state()
            take(lambda: on_turn(query))

        def on_turn(query: zenoh.Query) -> None:
            # What was said before the question counts in the answer.
            self.executor.poll()
            answer(query)

        callback = zenoh.handlers.Callback(on_query, indirect=False)
        self._declared.append(self._session.declare_queryable(key, callback, complete=True))

    def _announce(self) -> None:
        # A token is replaced only where it says something new, so that nobody blinks.
        keys = {keyexpr.endpoint_key(self.vehicle, offer()) for offer in self._offers}
        for key in self._tokens.keys() - keys:
            self._tokens.pop(key).undeclare()
        for key in keys - self._tokens.keys():
            self._tokens[key] = self._session.liveliness().declare_token(key)


class _Of(logging.LoggerAdapter[logging.Logger]):
    """Says of which vehicle a line tells, where there are several."""

    def __init__(self, vehicle: str, log: logging.Logger) -> None:
        super().__init__(log)
        self._vehicle = vehicle

    def process(self, msg: Any, kwargs: Any) -> Any:
        return f"{self._vehicle}: {msg}", kwargs
