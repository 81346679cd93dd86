"""Fake bus: a list of a node's messages and calls in order, without Zenoh.

    published = play("safety", run, params, [(POSE, pose), ...], calls)

The service's own `run` is executed, as fast as possible.
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, cast

from msgspec import Struct

from quadctl.schemas.messages import Called, Pose, Poses
from quadctl.schemas.params import Params
from quadctl.schemas.topics import POSE, POSE_SLOW, POSES, Service, Topic, period, set_params
from quadctl.schemas.typed import converted
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.live import LiveParams


class Published(NamedTuple):
    """Message that the node has published, and the name of its topic."""

    topic: str
    message: Any


def play(
    name: str,
    run: Callable[[Node, Params], None],
    params: Params,
    received: Iterable[tuple[Topic[Any], Struct]],
    calls: Iterable[Called] = (),
) -> list[Published]:
    """Run a service on recorded messages and calls; return the messages that it publishes.

    A call is executed at its simulated time: a scheduled one within that message, others after it.
    Without messages of `pose/slow` in the list, its poses also count as those when they are due.
    """
    script = FakeNode(name, params, received, calls)
    run(cast("Node", script), params)  # has every part of Node that services use
    return script.published


class FakeNode:
    """Stand-in for a Node, with its published messages in `published`."""

    def __init__(
        self,
        name: str,
        params: Params,
        received: Iterable[tuple[Topic[Any], Struct]],
        calls: Iterable[Called],
        *,
        vehicle: str = "uav",
    ) -> None:
        self.name, self.vehicle, self.restarted = name, vehicle, False
        self.log = logging.getLogger(f"script.{name}")
        self.stopping, self.reference_params, self.single, self.is_first = False, None, True, True
        self.on_params: Callable[[], None] | None = None
        self.in_force: Callable[[], dict[str, Any]] = dict
        self.published: list[Published] = []
        self._received, self._calls = deque(_as_published(list(received))), deque(calls)
        self._boots: set[str] = {""}
        self._now = ("", 0.0)
        self._listeners: dict[str, FakeSubscription] = {}
        self._services: dict[str, tuple[Service[Any, Any], Callable[[Any], Any]]] = {}
        live = LiveParams(name, params, lambda _table: None, self._changed)
        self.serve(set_params(name), live.set)

    def publisher(self, topic: Topic[Any], *_: Any, **__: Any) -> "FakePublisher":
        """Return a publisher that keeps its messages in `published`."""
        return FakePublisher(topic.name, self.published)

    def expects(self, _topic: Topic[Any]) -> bool:
        """Return False: nobody else runs."""
        return False

    def listen(
        self, topic: Topic[Any], handler: Callable[[Any], None] | None = None, *_: int, **__: bool
    ) -> "FakeSubscription":
        """Subscribe to the list's messages of a topic."""
        self._listeners[topic.name] = FakeSubscription(handler)
        return self._listeners[topic.name]

    def unlisten(self, subscription: "FakeSubscription") -> None:
        """End a subscription."""
        (name,) = (name for name, found in self._listeners.items() if found is subscription)
        del self._listeners[name]

    def serve(
        self, service: Service[Any, Any], handler: Callable[[Any], Any], **_: bool
    ) -> "FakeNode":
        """Execute the list's calls of a service."""
        self._services[service.name] = (service, handler)
        return self

    def ready(self) -> None:
        """Do nothing: there is no bus."""

    def advance_sim_time(self, boot: str, stamp: float, *_: object) -> None:
        """Set the simulated time (s) and execute the calls that were scheduled for it."""
        self._now = (boot, stamp)
        self._boots.add(boot)
        self._execute(held=True)

    def retime(self) -> None:
        """Do nothing: the list has its own times."""

    def post(self, item: Callable[[], None]) -> None:
        """Run a function at once: there is no loop."""
        item()

    def wait_for(self, condition: Callable[[], bool], _timeout: float) -> bool:
        """Play the list until the condition holds; return False at its end."""
        while not condition():
            if not self._next():
                return False
        return True

    def ticks(self, hz: float | Callable[[], float]) -> Iterator[float]:
        """Yield a tick in each period of simulated time, until the end of the list."""
        last = None
        # The node has declared all its services by now: any other call was for another node.
        self._calls = deque(call for call in self._calls if call.service in self._services)
        while self._next():
            now = self._now[1]
            if (tick := period(now, hz() if callable(hz) else hz)) != last:
                last = tick
                yield time.monotonic()
        self.stopping = True

    def every(self, hz: float | Callable[[], float], tick: Callable[[float], None]) -> None:
        """Call `tick` in each period of simulated time, until the end of the list."""
        for now in self.ticks(hz):
            tick(now)

    def _next(self) -> bool:
        self._execute(held=False)
        if not self._received:
            return False
        topic, message = self._received.popleft()
        if topic.name in self._listeners:
            self._listeners[topic.name].take(message)
        if isinstance(message, Pose):
            self._now = (message.boot, message.stamp)
            self._boots.add(message.boot)
        self._execute(held=False)
        return True

    def _execute(self, *, held: bool) -> None:
        while self._calls and self._calls[0].held is held and self._is_due(self._calls[0]):
            call = self._calls.popleft()
            service, handler = self._services[call.service]
            try:
                handler(converted(call.request, service.request))
            except QuadctlError as problem:
                self.log.info("%s: %s", call.service, problem.message)

    def _is_due(self, call: Called) -> bool:
        boot, stamp = self._now
        come = call.stamp <= stamp if call.boot == boot else call.boot in self._boots
        return come and call.service in self._services

    def _changed(self) -> None:
        if self.on_params is not None:
            self.on_params()


def _as_published(
    received: list[tuple[Topic[Any], Struct]],
) -> Iterator[tuple[Topic[Any], Struct]]:
    """Yield the messages, with what a vehicle adds to its poses: in batches, and slow ones if there are none."""
    lacks, last = all(topic is not POSE_SLOW for topic, _ in received), ("", -1)
    batch: list[Pose] = []
    for topic, message in received:
        yield topic, message
        if topic is POSE and isinstance(message, Pose):
            batch.append(message)
            now = message.boot, POSE_SLOW.period(message.stamp)
            if now != last:
                yield POSES, Poses(batch)
                batch = []
                if lacks:
                    yield POSE_SLOW, message
            last = now


class FakePublisher:
    """Publisher that keeps its messages in a list."""

    has_subscribers, part = True, None

    def __init__(self, topic: str, published: list[Published]) -> None:
        self._topic, self._published = topic, published

    def put(self, message: Struct, _rest: int = 0) -> None:
        """Keep a message."""
        self._published.append(Published(self._topic, message))


class FakeSubscription:
    """Subscription fed by `take`; `received` is the time of the last one, monotonic s."""

    def __init__(self, handler: Callable[[Any], None] | None) -> None:
        self.value: Any = None
        self.beats = None
        self.received = 0.0
        self._handler = handler

    @property
    def age(self) -> float:
        """Return the seconds since the newest message; infinite before the first."""
        return time.monotonic() - self.received if self.value is not None else float("inf")

    def poll(self) -> None:
        """Do nothing: messages do not wait."""

    def take(self, message: Any) -> None:
        """Receive a message."""
        self.value, self.received = message, time.monotonic()
        if self._handler is not None:
            self._handler(message)
