"""Process of the bridge to ROS 2: one session on our hub, one on the router of rmw_zenoh.

python -P -m quadctl.services.ros2 [--domain 0] [--router tcp/127.0.0.1:7447]

It holds no safety logic: a goal or a call goes the way of our own services, and is refused by them.
"""

import argparse
import contextlib
import itertools
import os
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from queue import Full, Queue
from typing import Any

from msgspec import Struct

from quadctl.schemas.messages import Pose, Pressure, SafetyState, Zones
from quadctl.schemas.params import Params
from quadctl.schemas.services import (
    CalibrateRequest,
    HoldRequest,
    ResetRequest,
    ToggleCageRequest,
)
from quadctl.schemas.topics import (
    CALIBRATE,
    GOTO,
    HOLD,
    POSE,
    PRESSURE,
    RESET,
    SETPOINT,
    STATE,
    TOGGLE_CAGE,
    ZONES,
    Service,
)
from quadctl.services.ros2 import cdr, graph, parameters, translation
from quadctl.services.ros2.messages import (
    DESCRIBE_PARAMETERS,
    GET_PARAMETER_TYPES,
    GET_PARAMETERS,
    LIST_PARAMETERS,
    SET_BOOL,
    SET_PARAMETERS,
    SET_PARAMETERS_ATOMICALLY,
    TRIGGER,
    Clock,
    FluidPressure,
    MarkerArray,
    Odometry,
    PoseStamped,
    RosService,
    RosTime,
    SetBoolRequest,
    String,
    TFMessage,
    TriggerRequest,
    TriggerResponse,
    type_of,
)
from quadctl.services.runtime.bus.foreign import ForeignQuery, ForeignSession, open_foreign
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.params.remote import RemoteParams

NAME = "ros2"
ROUTER = "tcp/127.0.0.1:7447"
_ROS_NODE = "quadctl"

_AGAIN = 1.0
"""Seconds between attempts to find the router."""
_TIMEOUT = 3.0
"""Seconds that a call to one of our services may take."""
_ids = itertools.count(1)
"""Ids of nodes and endpoints, in the graph of ROS."""
_MOST_WAITING = 64
"""Calls of ROS that may wait; beyond, they are refused."""


def main() -> None:
    """Parse the options that only the bridge has, then run its node."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    # As every program of ROS, unless told otherwise.
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    parser.add_argument("--domain", type=int, default=domain)
    parser.add_argument("--router", default=ROUTER)
    options, sys.argv[1:] = parser.parse_known_args()
    start(NAME, partial(run, RouterLink(options.router), options.domain), keeps_time=True)


def run(link: "RouterLink", domain: int, node: Node, params: Params) -> None:
    """Bridge one vehicle until stopped."""
    bridge = Bridge(node, domain, real_time=not params.dynamics.in_lockstep)
    node.listen(POSE, bridge.on_pose, inline=True)
    node.listen(PRESSURE, bridge.on_pressure)
    node.listen(STATE, bridge.on_state)
    node.listen(ZONES, bridge.on_zones)
    node.log.info("waiting for the ROS router at %s", link.endpoint)
    link.when_open(lambda session: node.post(lambda: bridge.join(session)))
    node.spin()


class RouterLink:
    """Session on the router, opened by a thread as soon as the router is there."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint = endpoint
        self._waiting: list[Callable[[ForeignSession], None]] = []
        self._session: ForeignSession | None = None
        self._lock, self._thread = threading.Lock(), threading.Thread(target=self._open)
        self._thread.daemon = True

    def when_open(self, act: Callable[[ForeignSession], None]) -> None:
        """Call `act` with the session, now or on the thread that opens it."""
        with self._lock:
            if self._session is None:
                self._waiting.append(act)
                if not self._thread.is_alive():
                    self._thread.start()
                return
        act(self._session)

    def _open(self) -> None:
        while (session := open_foreign(self.endpoint)) is None:
            time.sleep(_AGAIN)
        with self._lock:
            self._session = session
        for act in self._waiting:
            act(session)


class Outlet:
    """Publisher of a topic of ROS."""

    def __init__(self, session: ForeignSession, key: str, token: str, *, latched: bool) -> None:
        self._publisher, self._gid = session.publisher(key, latched=latched), graph.gid_of(token)
        self._sequence = 0

    @property
    def is_wanted(self) -> bool:
        """Return whether a message has a reader, or is kept for a late one."""
        return self._publisher.is_wanted

    def put(self, message: Struct) -> None:
        """Publish a message."""
        self._sequence += 1
        attachment = graph.attachment(self._sequence, time.time_ns(), self._gid)
        self._publisher.put(cdr.encode(message), attachment)


class Bridge:
    """Vehicle in the graph of ROS; silent until it joins.

    Its handlers run on the node's loop. Calls and goals of ROS wait for a thread, as ours block.
    """

    def __init__(self, node: Node, domain: int, *, real_time: bool) -> None:
        self._node, self._domain, self._real_time = node, domain, real_time
        self._outlets: dict[type[Struct], Outlet] = {}
        self._stamp = RosTime()
        self._zones: Zones = Zones(())
        self._shown: set[str] = set()
        self._height: float | None = None
        # A call must not wait for reads, which may be those of a node that is silent.
        self._calls: Queue[Callable[[], None]] = Queue(_MOST_WAITING)
        self._reads: Queue[Callable[[], None]] = Queue(_MOST_WAITING)
        self._lock, self._fault = threading.Lock(), ""
        self._goal: list[bytes] | None = None
        """Goal that waits behind all calls, so that a newer one may take its place."""

    def join(self, session: ForeignSession) -> None:
        """Declare all endpoints in the graph of ROS, and last the node."""
        vehicle = self._node.vehicle
        self._session = session
        self._ros = graph.GraphNode(self._domain, session.zid, self._number(), vehicle, _ROS_NODE)
        for message, name, latched in (
            (PoseStamped, f"/{vehicle}/pose", False),
            (Odometry, f"/{vehicle}/odom", False),
            (TFMessage, "/tf", False),
            (FluidPressure, f"/{vehicle}/pressure", False),
            (MarkerArray, f"/{vehicle}/cage", True),
            (String, f"/{vehicle}/safety_state", True),
            (Clock, "/clock", False),
        ):
            if message is Clock and (self._real_time or not self._node.is_first):
                continue
            self._outlets[message] = self._outlet(message, name, latched=latched)
        goals = f"/{vehicle}/goal_pose"
        key, _ = self._declare("MS", goals, type_of(PoseStamped), graph.RELIABLE)
        session.subscribe(key, self._on_goal)
        self._serve("toggle_cage", SET_BOOL, self._toggle_cage)
        self._serve("calibrate_pressure", TRIGGER, self._calibrate)
        self._serve("hold", TRIGGER, partial(self._trigger, HOLD, HoldRequest()))
        self._serve("reset", TRIGGER, partial(self._trigger, RESET, ResetRequest()))
        self._serve_parameters()
        session.announce(self._ros.token)
        threading.Thread(target=self._work, args=(self._calls,), daemon=True).start()
        threading.Thread(target=self._work, args=(self._reads,), daemon=True).start()
        threading.Thread(target=self._read_latest, daemon=True).start()
        self._node.log.info("joined the graph of ROS, domain %d", self._domain)

    def on_pose(self, pose: Pose) -> None:
        """Publish pose, odometry and transform, and where simulated time counts, the clock."""
        at = time.time_ns() if self._real_time else round(pose.stamp * 1e9)
        self._stamp = stamp = translation.time_of(at)
        vehicle = self._node.vehicle
        if self._wants(Clock):
            self._publish(Clock(stamp))
        if self._wants(PoseStamped):
            self._publish(translation.pose_stamped(pose, stamp))
        if self._wants(TFMessage):
            self._publish(translation.transform(pose, stamp, vehicle))
        if self._wants(Odometry):
            self._publish(translation.odometry(pose, stamp, vehicle))

    def on_pressure(self, reading: Pressure) -> None:
        """Publish the pressure."""
        if self._wants(FluidPressure):
            self._publish(translation.fluid_pressure(reading, self._stamp, self._node.vehicle))

    def on_state(self, state: SafetyState) -> None:
        """Publish the state and its reason, and the bounds: at 1 Hz, for a viewer that is late."""
        self._height = state.goal.z
        self._publish(translation.state_text(state))
        names = {zone.name for zone in self._zones.zones}
        self._publish(
            translation.bounds(state, self._zones.zones, self._shown - names, self._stamp)
        )
        self._shown |= names

    def on_zones(self, zones: Zones) -> None:
        """Take the zones, to show them with the next state."""
        self._zones = zones

    def _wants(self, message: type[Struct]) -> bool:
        """Return whether a message would be read: most graphs need one of pose, odometry and tf."""
        outlet = self._outlets.get(message)
        return outlet is not None and outlet.is_wanted

    def _publish(self, message: Struct) -> None:
        if outlet := self._outlets.get(type(message)):
            outlet.put(message)

    def _number(self) -> int:
        """Return the next id; those of several vehicles share a session, and differ."""
        return next(_ids)

    def _declare(self, kind: graph.Kind, name: str, type_: Any, qos: str) -> tuple[str, str]:
        """Announce an endpoint; return its key and its token."""
        number = self._number()
        token = self._ros.endpoint_token(number, kind, name, type_.name, type_.hash, qos)
        self._session.announce(token)
        return graph.endpoint_key(self._domain, name, type_.name, type_.hash), token

    def _outlet(self, message: type[Struct], name: str, *, latched: bool) -> Outlet:
        qos = graph.LATCHED if latched else graph.RELIABLE
        key, token = self._declare("MP", name, type_of(message), qos)
        return Outlet(self._session, key, token, latched=latched)

    def _serve(
        self,
        name: str,
        service: RosService[Any, Any],
        handler: Callable[[Any], Struct],
        *,
        reads: bool = False,
    ) -> None:
        key, _ = self._declare("SS", f"/{self._node.vehicle}/{name}", service, graph.RELIABLE)

        def on_query(query: ForeignQuery) -> None:
            try:
                with self._lock:
                    if not reads:
                        self._goal = None
                    queue = self._reads if reads else self._calls
                    queue.put_nowait(partial(self._answer, query, service, handler))
            except Full:
                query.refuse("too many calls wait: call again later")

        self._session.serve(key, on_query)

    def _answer(
        self,
        query: ForeignQuery,
        service: RosService[Any, Any],
        handler: Callable[[Any], Struct],
    ) -> None:
        attachment = graph.reply_attachment(query.attachment, time.time_ns())
        if attachment is None:
            query.refuse("the request has no attachment of rmw_zenoh 0.2.4 or later")
            return
        try:
            response = handler(cdr.decode(service.request, query.payload))
        except cdr.Malformed as problem:
            query.refuse(str(problem))
            return
        except Exception as fault:
            query.refuse(f"the bridge has a fault: {fault}")
            raise
        query.reply(cdr.encode(response), attachment)

    def _read_latest(self) -> None:
        """Take the state and the zones that were published before the bridge came."""
        # No safety yet: what it publishes from now on comes by itself.
        with contextlib.suppress(QuadctlError):
            zones = self._node.latest(ZONES, _TIMEOUT)
            self._node.post(lambda: self.on_zones(zones))
        with contextlib.suppress(QuadctlError):
            state = self._node.latest(STATE, _TIMEOUT)
            self._node.post(lambda: self.on_state(state))

    def _work(self, requests: Queue[Callable[[], None]]) -> None:
        """Execute calls and goals of ROS, or reads, one after the other."""
        while True:
            request = requests.get()
            try:
                request()
            except Exception:  # a fault in one call must not end all later ones
                self._node.log.exception("a call of ROS failed")

    def _on_goal(self, payload: bytes) -> None:
        """Keep the newest goal only, on a thread of Zenoh: a flood must not queue up."""
        with self._lock:
            if self._goal is not None:
                self._goal[0] = payload
                return
            goal = [payload]
            with contextlib.suppress(Full):
                self._calls.put_nowait(partial(self._fly, goal))
                self._goal = goal

    def _fly(self, newest: list[bytes]) -> None:
        """Request the newest goal from safety; its verdict shows in the state."""
        with self._lock:
            if self._goal is newest:
                self._goal = None
        try:
            goal = cdr.decode(PoseStamped, newest[0])
            reply = self._call(GOTO, translation.goal_of(goal, self._height))
        except (cdr.Malformed, QuadctlError) as problem:
            self._complain(f"ignored a goal: {problem}")
        else:
            self._complain("" if reply.accepted else f"safety refused a goal: {reply.reason}")
        # Safety decides at this rate; a flood of goals leaves room for calls.
        time.sleep(1 / SETPOINT.hz)

    def _complain(self, fault: str) -> None:
        """Log a fault once while it repeats: a foreign publisher must not fill the log."""
        if fault and fault != self._fault:
            self._node.log.warning("%s", fault)
        self._fault = fault

    def _call(self, service: Service[Any, Any], request: Struct) -> Any:
        return self._node.client(service).call(request, _TIMEOUT)

    def _toggle_cage(self, request: SetBoolRequest) -> TriggerResponse:
        return self._outcome(TOGGLE_CAGE, ToggleCageRequest(request.data))

    def _calibrate(self, _request: TriggerRequest) -> TriggerResponse:
        try:
            baseline = self._call(CALIBRATE, CalibrateRequest(zero=True)).baseline
        except QuadctlError as problem:
            return TriggerResponse(success=False, message=problem.message)
        return TriggerResponse(success=True, message=f"baseline: {baseline:.4f} hPa")

    def _trigger(
        self, service: Service[Any, Any], request: Struct, _request: TriggerRequest
    ) -> TriggerResponse:
        return self._outcome(service, request)

    def _serve_parameters(self) -> None:
        store = parameters.ParameterStore(RemoteParams(self._call, self._node.endpoints))
        for name, service, handler in (
            ("list_parameters", LIST_PARAMETERS, store.list),
            ("get_parameters", GET_PARAMETERS, store.get),
            ("get_parameter_types", GET_PARAMETER_TYPES, store.types),
            ("describe_parameters", DESCRIBE_PARAMETERS, store.describe),
            ("set_parameters", SET_PARAMETERS, store.set),
            ("set_parameters_atomically", SET_PARAMETERS_ATOMICALLY, store.set_atomically),
        ):
            self._serve(f"{_ROS_NODE}/{name}", service, handler, reads=True)

    def _outcome(self, service: Service[Any, Any], request: Struct) -> TriggerResponse:
        """Call our service; return its success, or the reason that it gives."""
        try:
            return TriggerResponse(success=self._call(service, request).success, message="")
        except QuadctlError as problem:
            return TriggerResponse(success=False, message=problem.message)


if __name__ == "__main__":
    main()
