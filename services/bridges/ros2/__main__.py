"""Process of the bridge to ROS 2: one session on our hub, one on the router of rmw_zenoh."""

import itertools
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__PoseStamped as PoseStamped,
    nav_msgs__msg__Odometry as Odometry,
    rosgraph_msgs__msg__Clock as Clock,
    sensor_msgs__msg__FluidPressure as FluidPressure,
    std_msgs__msg__String as String,
    tf2_msgs__msg__TFMessage as TFMessage,
    visualization_msgs__msg__MarkerArray as MarkerArray,
)

from quadctl.schemas.messages import Pose, Pressure, SafetyState, Zones
from quadctl.schemas.params import Params
from quadctl.schemas.topics import POSE, PRESSURE, STATE, ZONES
from quadctl.services.bridges.base import BridgedVehicle, Complaints, RequestQueue, run_bridge
from quadctl.services.bridges.options import Ros2Options
from quadctl.services.bridges.ros2 import graph, messages, translation
from quadctl.services.bridges.ros2.messages import SET_BOOL, TRIGGER, Malformed, RosService
from quadctl.services.bridges.ros2.parameters import ParameterStore
from quadctl.services.bridges.world import goal_of
from quadctl.services.runtime.bus.foreign import ForeignQuery, ForeignSession, open_foreign
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.recording.scene import Drawing

_ROS_NODE = "quadctl"
_AGAIN = 1.0
"""Seconds between attempts to find the router."""
_TOPICS = (
    (PoseStamped, "/{}/pose", graph.RELIABLE),
    (Odometry, "/{}/odom", graph.RELIABLE),
    (TFMessage, "/tf", graph.RELIABLE),
    (FluidPressure, "/{}/pressure", graph.RELIABLE),
    (MarkerArray, "/{}/cage", graph.LATCHED),
    (String, "/{}/safety_state", graph.LATCHED),
    (Clock, "/clock", graph.RELIABLE),
)
"""Types of the topics, their names with the vehicle, and their quality of service."""


class Ros2Bridge:
    """Session on the router, opened by a thread as soon as the router is there, and its vehicles."""

    def __init__(self, options: Ros2Options) -> None:
        self._options = options
        self._session: Future[ForeignSession] = Future()
        self.ids = itertools.count(1)
        """Ids of nodes and endpoints, in the graph of ROS."""

    def open(self, node: Node) -> None:
        """Wait for the router, on a thread."""
        self.domain = self._options.number
        node.log.info("waiting for the ROS router at %s", self._options.router)
        threading.Thread(target=self._open, daemon=True).start()

    def add(self, node: Node, params: Params) -> None:
        """Show a vehicle, once the router is there."""
        vehicle = RosVehicle(self, node, real_time=not params.dynamics.in_lockstep)
        self._session.add_done_callback(
            lambda session: node.post(partial(vehicle.join, session.result()))
        )

    def _open(self) -> None:
        while (session := open_foreign(self._options.router)) is None:
            time.sleep(_AGAIN)
        self._session.set_result(session)


class Outlet:
    """Publisher of a topic of ROS."""

    def __init__(self, session: ForeignSession, key: str, token: str, *, latched: bool) -> None:
        self._publisher, self._gid = session.publisher(key, latched=latched), graph.gid_of(token)
        self._sequence = 0

    def put(self, make: Callable[[], Any]) -> None:
        """Publish a message that somebody reads, or may read later: most graphs need one of pose, odometry and tf."""
        if not self._publisher.is_wanted:
            return
        self._sequence += 1
        attachment = graph.attachment(self._sequence, time.time_ns(), self._gid)
        self._publisher.put(messages.encode(make()), attachment)


class RosVehicle(BridgedVehicle):
    """Vehicle in the graph of ROS; silent until it joins. Its handlers run on the node's loop."""

    def __init__(self, bridge: Ros2Bridge, node: Node, *, real_time: bool) -> None:
        super().__init__(node)
        self._bridge, self._real_time = bridge, real_time
        self._outlets: dict[type, Outlet] = {}
        self._stamp, self._drawing = Time(0, 0), Drawing(self.name)
        self._requests = RequestQueue(
            lambda fault: node.log.error("a call of ROS failed", exc_info=fault)
        )
        self._complaints = Complaints(node.log.warning)
        node.listen(POSE, self._on_pose, inline=True)
        node.listen(PRESSURE, self._on_pressure)
        node.listen(STATE, self._on_state)
        node.listen(ZONES, self._on_zones)

    def join(self, session: ForeignSession) -> None:
        """Declare all endpoints in the graph of ROS, and last the node."""
        self._session, bridge, number = session, self._bridge, next(self._bridge.ids)
        self._ros = graph.GraphNode(bridge.domain, session.zid, number, self.name, _ROS_NODE)
        for type_, name, qos in _TOPICS:
            if type_ is Clock and (self._real_time or not self.node.is_first):
                continue
            key, token = self._declare("MP", name.format(self.name), _key_of(type_), qos)
            self._outlets[type_] = Outlet(session, key, token, latched=qos == graph.LATCHED)
        goals = f"/{self.name}/goal_pose"
        key, _ = self._declare("MS", goals, _key_of(PoseStamped), graph.RELIABLE)
        session.subscribe(key, self._on_goal)
        for name, service, do in (
            ("toggle_cage", SET_BOOL, lambda given: self.toggle_cage(on=given.data)),
            ("calibrate_pressure", TRIGGER, lambda _: self._calibrated()),
            ("hold", TRIGGER, lambda _: self.hold()),
            ("reset", TRIGGER, lambda _: self.reset()),
        ):
            self._serve(name, service, partial(_outcome, do))
        for name, (service, handler) in ParameterStore(self.parameters).services.items():
            self._serve(f"{_ROS_NODE}/{name}", service, _as_fields(handler), reads=True)
        session.announce(self._ros.token)
        # What came before the outlets were there.
        self._show_state()
        self.node.log.info("joined the graph of ROS, domain %d", bridge.domain)

    # Topics

    def _on_pose(self, pose: Pose) -> None:
        """Publish pose, odometry and transform, and where simulated time counts, the clock."""
        at = time.time_ns() if self._real_time else round(pose.stamp * 1e9)
        self._stamp = stamp = translation.time_of(at)
        self._publish(Clock, lambda: Clock(stamp))
        self._publish(PoseStamped, lambda: translation.pose_stamped(pose, stamp))
        self._publish(TFMessage, lambda: translation.transform(pose, stamp, self.name))
        self._publish(Odometry, lambda: translation.odometry(pose, stamp, self.name))

    def _on_pressure(self, reading: Pressure) -> None:
        self._publish(
            FluidPressure, lambda: translation.fluid_pressure(reading, self._stamp, self.name)
        )

    def _on_state(self, state: SafetyState) -> None:
        self.see(state)
        self._drawing.derive("", state, 0)
        self._show_state()

    def _on_zones(self, zones: Zones) -> None:
        self._drawing.derive("", zones, 0)
        self._show_state()

    def _show_state(self) -> None:
        """Publish the state with its reason, and the scene; both are kept for a viewer that is late."""
        state, scene = self._drawing.state, self._drawing.whole(0)
        if state is not None and scene is not None:
            self._publish(String, lambda: translation.state_text(state))
            self._publish(MarkerArray, lambda: translation.markers(scene, self._stamp, self.name))

    def _publish(self, type_: type, make: Callable[[], Any]) -> None:
        """Publish a message, once the vehicle has joined."""
        if outlet := self._outlets.get(type_):
            outlet.put(make)

    # Goals and calls

    def _on_goal(self, payload: bytes) -> None:
        self._requests.order(partial(self._fly_to, payload), newest="goal")

    def _fly_to(self, payload: bytes) -> None:
        """Request a goal from safety; its verdict shows in the state."""
        try:
            goal = messages.decode(PoseStamped.__msgtype__, payload)
            at = goal.pose.position
            place = at.x, at.y, at.z
            self.fly(goal_of(goal.header.frame_id, place, self.height, grounded=True))
        except (Malformed, QuadctlError) as problem:
            self._complaints.show(f"ignored a goal: {problem}")
        else:
            self._complaints.show("")

    def _calibrated(self) -> str:
        return f"baseline: {self.calibrate():.4f} hPa"

    def _declare(self, kind: graph.Kind, name: str, type_: str, qos: str) -> tuple[str, str]:
        """Announce an endpoint; return its key and its token."""
        token = self._ros.endpoint_token(next(self._bridge.ids), kind, name, type_, qos)
        self._session.announce(token)
        return graph.endpoint_key(self._bridge.domain, name, type_), token

    def _serve(
        self,
        name: str,
        service: RosService,
        handler: Callable[[Any], tuple[Any, ...]],
        *,
        reads: bool = False,
    ) -> None:
        """Serve a service; the handler returns the fields of its response."""
        type_ = graph.type_key(service.name, service.hash)
        key, _ = self._declare("SS", f"/{self.name}/{name}", type_, graph.RELIABLE)
        add = self._requests.read if reads else self._requests.order

        def on_query(query: ForeignQuery) -> None:
            if add(partial(_answer, query, service, handler)) == "full":
                query.refuse("too many calls wait: call again later")

        self._session.serve(key, on_query)


def _key_of(type_: Any) -> str:
    return graph.type_key(type_.__msgtype__, messages.type_hash(type_.__msgtype__))


def _outcome(do: Callable[[Any], str | None], request: Any) -> tuple[bool, str]:
    """Return the fields of an outcome: success with a text, or the reason of a failure."""
    try:
        return True, do(request) or ""
    except QuadctlError as problem:
        return False, problem.message


def _as_fields(handler: Callable[[Any], Any]) -> Callable[[Any], tuple[Any, ...]]:
    return lambda request: (handler(request),)


def _answer(
    query: ForeignQuery, service: RosService, handler: Callable[[Any], tuple[Any, ...]]
) -> None:
    attachment = graph.reply_attachment(query.attachment, time.time_ns())
    if attachment is None:
        query.refuse("the request has no attachment of rmw_zenoh 0.2.4 or later")
        return
    try:
        fields = handler(messages.decode(service.request, query.payload))
    except (Malformed, QuadctlError) as problem:
        query.refuse(str(problem))
        return
    except Exception as fault:
        query.refuse(f"the bridge has a fault: {fault}")
        raise
    query.reply(messages.encode(messages.message(service.response, *fields)), attachment)


if __name__ == "__main__":
    run_bridge("ros2", Ros2Options, Ros2Bridge)
