"""Node: a service of one vehicle on the bus, with one loop for all its handlers."""

import gc
import logging
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import zenoh
from msgspec import Struct
from msgspec.structs import replace

from quadctl.schemas import keyexpr
from quadctl.schemas.messages import Pose
from quadctl.schemas.params import Params
from quadctl.schemas.roles import Right
from quadctl.schemas.topics import POSE, POSE_SLOW, SETPOINT, Service, Topic, period
from quadctl.services.runtime.bus import codec, liveliness, zenoh_events
from quadctl.services.runtime.bus.bundles import Bundles
from quadctl.services.runtime.bus.calls import ServiceClient
from quadctl.services.runtime.bus.client import latest
from quadctl.services.runtime.bus.pubsub import Publisher, Subscription
from quadctl.services.runtime.bus.streams import RawMessage, RawSubscriber, RecorderSubscriber
from quadctl.services.runtime.errors import AlreadyServed
from quadctl.services.runtime.executor import Executor, Item
from quadctl.services.runtime.server import CallLog, QueryQueue, Schedule, Server
from quadctl.services.runtime.typed import positive_rate, require, require_function

M = TypeVar("M", bound=Struct)
Q = TypeVar("Q", bound=Struct)
R = TypeVar("R", bound=Struct)

_DEPTH = 1000
"""Messages that may wait for a handler: a hundredth of a second of a flood."""
_POSES = (POSE, POSE_SLOW)
_ALL = 100_000
"""Poses that may wait for a node that follows simulated time: no clock waits for it."""
LOST_AFTER = 1.5 / SETPOINT.hz
"""Seconds after an answer to a pose: a pose repeated later means that the answer was lost. A vehicle
with a frozen pose repeats it, too, in each period."""
FIRST_POSE = 1.0
"""Seconds that readiness waits for a first slow pose, so that a client can fly or calibrate at once."""
_LONGEST_WAIT = 3600.0
"""Seconds of one wait for a pose; a queue cannot wait for ever."""


class Node:
    """Interface of a service to the bus: topics, services and ticks of one vehicle.

    `restarted`: this process replaces a dead one. `reference_params`: the parameters of the
    process's first vehicle, None if that is this one. `single`: the process has no other vehicle.
    `lockstep`: calls may be scheduled, and a publisher waits for a slow subscriber and drops no message.
    The node then follows simulated time, by the poses; with `keeps_time` it advances it itself, and its
    ticks are those of the machine.
    `present`: what else is there, if it has been asked for the process's vehicles together.
    `connect`: the hub's endpoint if it is not the realm's own. `guarded`: the hub lets it do no more
    than its name stands for. `bundles`: what the run's processes send each other for all vehicles together.
    Raises AlreadyServed when another process is this node.
    """

    def __init__(
        self,
        name: str,
        vehicle: str,
        session: zenoh.Session,
        executor: Executor | None = None,
        *,
        present: liveliness.Present | None = None,
        restarted: bool = False,
        reference_params: Params | None = None,
        single: bool = True,
        lockstep: bool = False,
        keeps_time: bool = False,
        connect: str = "",
        guarded: bool = False,
        bundles: Bundles | None = None,
    ) -> None:
        # In lock-step no message may be dropped.
        self._bundles = None if lockstep else bundles
        self._connect, self._guarded = connect, guarded
        self.name, self.vehicle, self.restarted = name, vehicle, restarted
        self.reference_params, self.single = reference_params, single
        self._lockstep = lockstep
        self._follows = lockstep and not keeps_time
        present = present or liveliness.present(session, [vehicle])
        self._servers = dict(present.servers)
        if (vehicle, name) in present.nodes:
            raise AlreadyServed(f"another process is already the node {name} of {vehicle}")
        log = logging.getLogger(name)
        self.log = log if single else _VehicleLog(vehicle, log)
        self._session = session
        self.executor = executor or Executor()
        self._declared: list[Any] = []
        self._subscribers: dict[Subscription[Any], Callable[[], None]] = {}
        """Subscriptions, and the function that ends each."""
        self._offers: list[Callable[[], keyexpr.EndpointInfo]] = []
        self._subscribed: dict[Subscription[Any], keyexpr.EndpointInfo] = {}
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self._schedule = Schedule(lockstep=lockstep)
        self._followed: set[Subscription[Any]] = set()
        """Subscriptions to poses, each of which advances simulated time."""
        self._passed: deque[Pose] | None = None
        """Poses that ticks of simulated time have not yet counted; None without such ticks."""
        self._setpoints: Publisher[Any] | None = None
        self._ready = False
        self.on_params: Callable[[], None] | None = None
        self.in_force: Callable[[], dict[str, Any]] = dict

    def publisher(
        self,
        topic: Topic[M],
        hz: Callable[[], float] | None = None,
        *,
        together: bool = False,
    ) -> Publisher[M]:
        """Declare a topic, at its own rate or at `hz()` now and after each change of parameters.

        With `together`, messages of several vehicles go out when all that are due have run, to the other
        processes of the run as one: an answer to the first would else interrupt the others. Raises NotAllowed if a guarded node may
        not publish the topic.
        """
        require(topic, Topic, "STATE of quadctl.schemas.topics")
        key = topic.key(self.vehicle)
        self._check("publish", key)
        if not topic.name.startswith("@"):  # what a wildcard does not match is the lab's own affair
            self._offers.append(
                lambda: self._endpoint("@pub", topic, topic.hz if hz is None else hz())
            )
        defer = self.executor.defer if together and not self.single else None
        part = self._bundles.out(topic, self.vehicle) if together and self._bundles else None
        publisher = Publisher(
            self._session, key, topic, waits=self._lockstep, defer=defer, part=part,
            on_match=self._on_match,
        )  # fmt: skip
        if topic.latched:
            self._answer_queries(key, publisher.answer)
        if topic is SETPOINT:
            self._setpoints = publisher
        return publisher

    def expects(self, topic: Topic[Any]) -> bool:
        """Return whether the topic comes from a process of this run, also if it is late."""
        return self._bundles is not None and self._bundles.has(topic)

    def listen(
        self,
        topic: Topic[M],
        handler: Callable[[M], None] | None = None,
        depth: int = _DEPTH,
        *,
        inline: bool = False,
        wakes: bool | Callable[[], bool] = True,
        skips: bool = False,
    ) -> Subscription[M]:
        """Subscribe to a topic; the handler, if any, runs on the node's loop.

        Of a latched topic its last message comes as well, if no newer one does. With `inline` the handler may
        run earlier, on a Zenoh thread, and must not block. A topic that does not wake the loop, or not while
        `wakes()` is False, is handled at its next call or tick. If it `skips`, the poses that a vehicle at rest
        repeats come as one, then or before another one. In a node that follows simulated
        time, it advances to each pose before the pose's handler runs.
        """
        require(topic, Topic, "POSE_SLOW of quadctl.schemas.topics")
        if handler is not None:
            require_function(handler)
        advances = handler is not None and self._follows and topic in _POSES
        if handler is not None and advances:
            handler, depth = self._advancing(handler), _ALL

        def awaited() -> bool:
            return (
                self.executor.waits > 0 or self._schedule.holding or (callable(wakes) and wakes())
            )

        post = self.executor.post
        bundles = self._bundles if self.expects(topic) else None
        now = post
        if inline:
            now = self.executor.join_in if bundles else self.executor.run_inline
        subscription = Subscription(
            topic, post, now, awaited, handler, depth, wakes=wakes is True, skips=skips
        )
        subscription.may_wake = bool(wakes)
        self.executor.add_poller(subscription.poll)
        key = topic.key(self.vehicle)
        if bundles:
            end = bundles.subscribe(topic, self.vehicle, subscription)
        else:
            callback = zenoh.handlers.Callback(subscription.on_sample, indirect=False)
            end = self._session.declare_subscriber(key, callback).undeclare
        self._subscribers[subscription] = end
        if topic.latched:
            zenoh_events.request_latched(self._session, key, subscription.on_latched)
        if advances:
            self._followed.add(subscription)
        if not topic.name.startswith("@"):  # calls are announced as services
            self._subscribed[subscription] = self._endpoint("@sub", topic, topic.hz)
            if self._ready:
                self._announce()
        return subscription

    def unlisten(self, subscription: Subscription[Any]) -> None:
        """End a subscription; messages that wait for its handler are dropped."""
        require(subscription, Subscription, "the result of `listen`")
        self._subscribers.pop(subscription)()
        self.executor.remove_poller(subscription.poll)
        self._followed.discard(subscription)
        if self._subscribed.pop(subscription, None) and self._ready:
            self._announce()

    def tap(self, keys: tuple[str, ...]) -> RecorderSubscriber:
        """Subscribe to keys or key expressions, undecoded."""
        return RecorderSubscriber(self._session, keys)

    def listen_raw(
        self, keys: tuple[str, ...], handler: Callable[[RawMessage], None]
    ) -> RawSubscriber:
        """Subscribe to keys or key expressions, undecoded; see RawSubscriber for the handler."""
        return RawSubscriber(self._session, keys, handler)

    def endpoints(self) -> list[keyexpr.EndpointInfo]:
        """Return what the vehicle's nodes publish, serve and subscribe to; it blocks."""
        return liveliness.offers(self._session, self.vehicle, "@pub", "@srv", "@sub")

    def client(self, service: Service[Q, R]) -> ServiceClient[Q, R]:
        """Return a client of another node's service; a call blocks, so make it on a thread.

        Raises NotAllowed if the role of our certificate does not permit the call, or a guarded node
        may not make it.
        """
        require(service, Service, "GOTO of quadctl.schemas.topics")
        if self._connect:
            from quadctl.services.runtime.security import permissions

            permissions.check(self._connect, "call", service.key(self.vehicle))
        self._check("call", service.key(self.vehicle))
        return ServiceClient(self._session, self.vehicle, service)

    def latest(self, topic: Topic[M], timeout: float) -> M:
        """Return the last message of a latched topic; it blocks and raises as `latest` does."""
        require(topic, Topic, "STATE of quadctl.schemas.topics")
        return latest(self._session, topic, topic.key(self.vehicle), timeout)

    def serve(
        self, service: Service[Q, R], handler: Callable[[Q], R], *, inline: bool = False
    ) -> Server[Q, R]:
        """Serve a service; the handler runs on the node's loop and may raise a QuadctlError.

        With `inline` it may run earlier, on a Zenoh thread, and must not block. Raises
        AlreadyServed when another node serves it, or this one already, NotAllowed if a guarded node may not.
        """
        require(service, Service, "TOGGLE_CAGE of quadctl.schemas.topics")
        require_function(handler)
        self._check("serve", service.key(self.vehicle))
        journal = None
        if not service.reads:
            journal = CallLog(self._session, self.vehicle, service, self._schedule)

        def handle(request: Q) -> R:
            try:
                reply = handler(request)
            finally:
                # What was published before a reply must reach a caller before it.
                self.executor.flush()
            if not isinstance(reply, service.response):
                raise TypeError(_wrong_reply(handler, reply, service.response))
            return reply

        server = Server(self.vehicle, service, handle, self._schedule, journal)
        if other := self._servers.get(server.key):
            own = "serve each service once; `start` serves the node's parameters"
            hint = own if other == self.name else f"`quadctl up --without {other}` leaves it out"
            raise AlreadyServed(f"{server.key} is already served by the node {other}", hint)
        self._servers[server.key] = self.name
        name, digest = service.type_name, codec.digest(service.request)
        offer = keyexpr.EndpointInfo(self.vehicle, "@srv", self.name, name, digest, 0.0, server.key)
        self._offers.append(lambda: offer)
        self._answer_queries(server.key, server.answer, inline=inline)
        return server

    def advance_sim_time(self, boot: str, stamp: float, first: Item | None = None) -> None:
        """Set the simulated time to `stamp` (s) of `boot`; if calls are due, call `first` and execute them."""
        self._schedule.advance(boot, stamp, time.monotonic(), first)

    @property
    def is_first(self) -> bool:
        """Return whether this is the node of its process's first vehicle."""
        return self.reference_params is None

    def _on_match(self) -> None:
        if self._ready:  # a rate may depend on it; in a large launch, all match at once
            self.executor.retime()

    def retime(self) -> None:
        """Read the rate of `every` again; safe to call from any thread."""
        self.executor.retime()

    def params_changed(self) -> None:
        """Notify the service of new parameter values and update the rates that depend on them."""
        if self.on_params is not None:
            self.on_params()
        self.executor.retime()
        if self._ready:
            self._announce()

    def params_in_force(self) -> dict[str, Any]:
        """Return by name the values still in force of parameters that wait for a standstill."""
        return self.in_force()

    def ready(self) -> None:
        """Declare the endpoints, and last the node: a client that sees it may call it at once.

        A node that follows simulated time waits for a first pose: calls may be scheduled then.
        """
        if self._ready:
            return
        if self._follows:
            if not self._followed:
                self.listen(POSE_SLOW, lambda _pose: None)
            self.wait_for(lambda: bool(self._schedule.now[0]), FIRST_POSE)
        self._ready = self.executor.is_ready = True
        # What exists now stays: with a thousand vehicles, to search it for garbage takes 0.1 s each time.
        gc.freeze()
        gc.set_threshold(10_000)  # nor are the messages of a bundle garbage
        self._announce()
        key = keyexpr.node_key(self.vehicle, self.name)
        self._declared.append(self._session.liveliness().declare_token(key))

    def ticks(self, hz: float | Callable[[], float]) -> Iterator[float]:
        """Declare the node ready and yield the time (s) at a rate (Hz) until stopped.

        Services run in between. The time is monotonic, in a node that follows simulated time
        simulated; a pose may advance it by several ticks. A callable rate may change.
        """
        if not callable(hz):
            positive_rate(hz)
        if self._follows:
            return self._simulated_ticks(hz if callable(hz) else lambda: hz)
        self.ready()
        return self.executor.ticks(hz)

    def every(self, hz: float | Callable[[], float], tick: Callable[[float], None]) -> None:
        """Declare the node ready and call `tick` with the time (s) at a rate (Hz) until stopped.

        It is `ticks` for a function that waits for nothing: of several vehicles, it costs less.
        """
        if self._lockstep:
            for now in self.ticks(hz):
                tick(now)
        else:
            self.ready()
            self.executor.every(hz, tick)

    def _simulated_ticks(self, rate: Callable[[], float]) -> Iterator[float]:
        self._passed = passed = deque[Pose]()
        self.ready()
        counted, ticks, answered, answered_at = ("", 0.0), 0, -1, 0.0
        while not self.stopping:
            if not self.wait_for(lambda: bool(passed), _LONGEST_WAIT):
                continue
            pose, hz = _oldest(passed), rate()
            now, due = period(pose.stamp, hz), SETPOINT.period(pose.stamp)
            if (pose.boot, hz) != counted:
                # Another count begins: with a tick.
                counted, ticks = (pose.boot, hz), now - 1
            if now > ticks:
                for _ in range(now - ticks):
                    yield pose.stamp
                ticks = now
            elif due != answered or time.monotonic() - answered_at > LOST_AFTER:
                self._repeat_setpoint(pose)
            answered, answered_at = due, time.monotonic()

    def _repeat_setpoint(self, pose: Pose) -> None:
        """Answer a pose without a tick: dynamics waits for it, and a slower loop holds its setpoint."""
        if (setpoints := self._setpoints) is None or (last := setpoints.last) is None:
            return
        if last.boot == pose.boot:
            setpoints.put(replace(last, for_seq=pose.seq))

    def poses(self) -> Iterator[Pose]:
        """Yield the first pose of each period of 50 ms until stopped; ready with the first of all.

        The time is that of the simulation: a node that loops over its poses keeps step at any
        speed. Services run in between, and scheduled calls at their times. In real time a loop that
        is late gets the newest pose. A pose that comes again, as its setpoint was lost, is yielded again.
        """
        waiting: deque[Pose] = deque(maxlen=None if self._lockstep else 1)
        self._follows = False  # simulated time advances with the poses that are yielded
        self.listen(POSE_SLOW, waiting.append, _DEPTH)
        if not self.wait_for(lambda: bool(waiting), FIRST_POSE):
            # A vehicle that is not ours may publish no slow poses.
            self.listen(POSE, waiting.append, _DEPTH)
        self.ready()
        last, answered_at = ("", -1), 0.0
        while not self.stopping:
            if not self.wait_for(lambda: bool(waiting), _LONGEST_WAIT):
                continue
            pose = _oldest(waiting)
            now = pose.boot, SETPOINT.period(pose.stamp)
            if now != last or time.monotonic() - answered_at > LOST_AFTER:
                last = now
                self.advance_sim_time(pose.boot, pose.stamp)
                yield pose
                answered_at = time.monotonic()

    def spin(self) -> None:
        """Declare the node ready and serve its queue until stopped, for a node without ticks."""
        self.ready()
        self.executor.spin()

    def post(self, item: Callable[[], None]) -> None:
        """Run a function soon, on this node's loop; safe to call from any thread."""
        self.executor.post(item)

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Serve the queue until the condition holds; False at the timeout (s) or when stopped.

        What is queued is served first: a loop that sleeps longer than a pose takes would else find
        its condition true each time, and answer no call.
        """
        self.executor.serve_waiting()
        if self._bundles is None:
            return self.executor.wait_for(condition, timeout)
        self._bundles.waits += 1
        try:
            return self.executor.wait_for(condition, timeout)
        finally:
            self._bundles.waits -= 1

    @property
    def stopping(self) -> bool:
        """Return whether the loop must end."""
        return self.executor.stopping

    def _advancing(self, handler: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a handler of poses before which simulated time advances."""

        def handle(pose: Pose) -> None:
            if self._follows:
                self.advance_sim_time(pose.boot, pose.stamp)
            handler(pose)
            if self._passed is not None:
                self._passed.append(pose)

        return handle

    def _check(self, right: Right, key: str) -> None:
        if self._guarded:
            from quadctl.services.runtime.security import permissions

            permissions.check_node(self.name, right, key)

    def _answer_queries(
        self, key: str, answer: Callable[[zenoh.Query], None], *, inline: bool = False
    ) -> None:
        queue = QueryQueue(self.executor, answer, inline=inline)
        callback = zenoh.handlers.Callback(queue.on_query, indirect=False)
        self._declared.append(self._session.declare_queryable(key, callback, complete=True))

    def _endpoint(self, kind: keyexpr.Kind, topic: Topic[M], hz: float) -> keyexpr.EndpointInfo:
        name, digest = topic.type.__name__, codec.digest(topic.type)
        key = topic.key(self.vehicle)
        return keyexpr.EndpointInfo(self.vehicle, kind, self.name, name, digest, hz, key)

    def _announce(self) -> None:
        # An unchanged token stays: an endpoint must not disappear, even for a moment.
        offers = [*(offer() for offer in self._offers), *self._subscribed.values()]
        keys = {*map(keyexpr.endpoint_key, offers)}
        for key in self._tokens.keys() - keys:
            self._tokens.pop(key).undeclare()
        for key in keys - self._tokens.keys():
            self._tokens[key] = self._session.liveliness().declare_token(key)


def _oldest(waiting: deque[Pose]) -> Pose:
    """Take the oldest pose out, and with it those of boots that have ended."""
    pose, newest = waiting.popleft(), waiting[-1].boot if waiting else ""
    while newest not in {"", pose.boot}:
        pose = waiting.popleft()
    return pose


class _VehicleLog(logging.LoggerAdapter[logging.Logger]):
    """Logger of a process with several vehicles: each line begins with the vehicle's name."""

    def __init__(self, vehicle: str, log: logging.Logger) -> None:
        super().__init__(log)
        self._vehicle = vehicle

    def process(self, msg: Any, kwargs: Any) -> Any:
        return f"{self._vehicle}: {msg}", kwargs


def _wrong_reply(handler: Callable[..., Any], reply: Any, response: type) -> str:
    name, code = getattr(handler, "__qualname__", repr(handler)), getattr(handler, "__code__", None)
    place = f" ({os.path.basename(code.co_filename)}, line {code.co_firstlineno})" if code else ""  # noqa: PTH119 - pathlib is slow
    return f"{name}{place} returned {reply!r:.80}, not a {response.__name__}"
