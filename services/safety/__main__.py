"""Process of safety: verifies every goal; the only process that publishes setpoints."""

import time
from collections.abc import Callable
from functools import partial
from threading import RLock

from msgspec.structs import replace

from quadctl.schemas.messages import (
    WAITS,
    Info,
    NearestWall,
    Pose,
    Position,
    SafetyState,
    Waypoint,
)
from quadctl.schemas.params import Params
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    HoldRequest,
    HoldResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import (
    GOTO,
    HOLD,
    INFO,
    POSE,
    POSE_SLOW,
    REQUEST,
    SERVICES,
    SETPOINT,
    STATE,
    TOGGLE_CAGE,
    TOPICS,
    ZONES,
)
from quadctl.services.airspace import airworthiness
from quadctl.services.airspace.cage import bounds
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.errors import NotReady
from quadctl.services.runtime.followed_params import follow
from quadctl.services.runtime.node import FIRST_POSE, LOST_AFTER, Node
from quadctl.services.runtime.params.load import launch_lines
from quadctl.services.safety.monitor import Monitor
from quadctl.services.safety.traffic import Traffic

_UNSEEN = 1 / POSE_SLOW.hz - 1 / POSE.hz
"""Time (s) by which a slow pose may be older than the vehicle's newest one: no part of a silence."""
_REQUESTS = 10
"""Requested positions that may wait: each costs a verdict, and only the newest one counts."""
_PATIENCE = 5.0
"""Time (s) after which the others of a launch take off without a vehicle that has no pose."""
_PUBLISHED = 1.0
"""Times a second that the state is published at least."""
_LATE = 0.15
"""Time (s) without beats after which the vehicles at rest are watched again."""
_LEAST_GAP = 2.01 / SETPOINT.hz
"""Shortest gap (s) between the newest poses at two ticks that means a lack of setpoints: with poses
and ticks at the same rate, jitter of a millisecond can make it two periods."""


class SafetyProcess:
    """Vehicles of this process, and its own delays.

    All its loops run on one thread: what holds up one holds up all.
    """

    def __init__(self) -> None:
        self.ticked, self.resumed, self._held = time.monotonic(), 0.0, 0.0
        """When a loop ticked last, and when after a delay (monotonic s); and how long (s) that was."""
        self.looks = 0
        """Looks at all vehicles so far."""
        self.vehicles: list[Safety] = []
        self.traffic = Traffic(RLock())  # an inline item of one node may run beside another's loop

    def tick(self, now: float) -> None:
        """Record a tick of a loop at a time, monotonic s."""
        if now - self.ticked > 2 / SETPOINT.hz:
            self.resumed, self._held = now, now - self.ticked
        self.ticked = now

    def since(self, seen: float) -> float:
        """Return for how long (s) the process was held up after a time (monotonic s), if it was."""
        return self._held if self.resumed > seen else 0.0


class Safety:
    """Handlers of messages, calls and ticks."""

    def __init__(self, node: Node, params: Params, process: SafetyProcess) -> None:
        self._node, self._params, self._process = node, params, process
        self._traffic = traffic = process.traffic
        self._is_stepped = params.dynamics.in_lockstep
        """True in lock-step: silence then stops the clock, not the flight."""
        self._states = node.publisher(STATE)
        self._setpoints = node.publisher(SETPOINT, together=True)
        self._zones = node.publisher(ZONES)
        self.monitor = Monitor(
            params.safety, self._on_state, restarted=node.restarted, grace=params.dynamics.grace,
            name=node.vehicle, traffic=traffic, post=node.post,
        )  # fmt: skip
        if not (node.single or self._is_stepped):
            traffic.expect(node.vehicle)
        self._answered, self._waiting, self._seen, self._sent = -1, False, 0.0, 0.0
        self._looks = 0
        """Looks at all vehicles when a pose was observed last."""
        self._count, self._begun = 0, 0.0
        self._repeats = self._leads = False
        self._newest, self._deciding = self.monitor.pose, False
        self._poses = node.listen(POSE_SLOW, self._on_pose, inline=True, skips=True)
        node.listen(REQUEST, self._on_waypoint, _REQUESTS, inline=True)
        node.on_params = self._on_params
        # Body, limits, wind, and patience for setpoints.
        follow(node, "dynamics", params, self._on_vehicle, inline=True)
        self._judge_vehicle()
        self._zones.put(self.monitor.zones)
        self._near = NearestWall()
        self.publish()

    def _on_params(self) -> None:
        self._zones.put(self.monitor.zones)
        self.monitor.resize()

    def _on_vehicle(self) -> None:
        self._poses.poll()
        self._judge_vehicle()

    def _judge_vehicle(self) -> None:
        params = self._params.dynamics
        vehicle = params.vehicle, params.control, params.wind
        self.monitor.set_vehicle(*vehicle)
        self.monitor.set_landing(airworthiness.why_not_held(*vehicle))
        self._send_setpoint()

    def listen_to_all_poses(self) -> None:
        """Subscribe to the fast poses, too: a vehicle that is not ours may publish no others."""
        self._poses = self._node.listen(POSE, self._on_pose, inline=True)

    def serve(self) -> None:
        """Declare the services."""
        self._node.serve(GOTO, self._goto)
        self._node.serve(HOLD, self._hold, inline=True)
        self._node.serve(TOGGLE_CAGE, self._toggle_cage, inline=True)

    def publish(self) -> None:
        """Publish the current state."""
        state = self.monitor.state()
        self._near = state.nearest
        self._states.put(state)

    def _warn(self) -> None:
        """Publish the state when the vehicle comes near a wall or leaves it: no other event does."""
        near, before = self.monitor.nearest(), self._near
        if (near.near and near.name) != (before.near and before.name):
            self.publish()

    def run(self) -> None:
        """Tick until stopped: once a second, but the vehicle that begins first looks after all, at each setpoint.

        A tick of a loop costs more than a look.
        """
        self._begun, vehicles = time.monotonic(), self._process.vehicles
        vehicles.append(self)
        self._leads = self is vehicles[0]
        try:
            self._node.every(SETPOINT.hz if self._leads else _PUBLISHED, self._tick)
        finally:
            vehicles.remove(self)  # a new session begins with new ones

    def _tick(self, now: float) -> None:
        self._process.tick(now)
        if self._leads:
            self._process.looks += 1
            for each in self._process.vehicles:
                each.look(now)
        if not self._leads or self._count % (SETPOINT.hz / _PUBLISHED) == 0:
            self.publish()
        self._count += 1

    def look(self, now: float) -> None:
        """Watch the vehicle if it is silent; let it take off when all may. In any tick.

        Otherwise each pose has it watched: then its data is at hand, here it is far.
        """
        if beats := self._poses.beats:
            silent = now - beats.received > _LATE
        else:
            silent = now - self._seen - _UNSEEN > self._params.safety.pose_timeout
        if silent:
            self._on_turn(self.watch)
        if self._traffic.begins and (self.monitor.fresh or now - self._begun > _PATIENCE):
            self._traffic.attend(self._node.vehicle)
        if self.monitor.takes_off and self._traffic.may_take_off(now):
            self._on_turn(self.monitor.take_off)

    def _on_turn(self, item: Callable[[], None]) -> None:
        if self._leads:
            item()
        else:
            self._node.executor.join_in(item)

    def watch(self) -> None:
        """Stop the flight if poses or setpoints are missing; in lock-step the clock waits instead.

        After a delay of this process itself, the poses on their way to it count first.
        """
        if self._is_stepped:
            return
        self._poses.poll()
        if beats := self._poses.beats:
            self._seen = beats.received
        now = time.monotonic()
        just_resumed = now - self._process.resumed <= self._params.safety.pose_timeout
        if self._observe(None if just_resumed else now - self._seen - _UNSEEN):
            self._send_setpoint()

    def _observe(self, age: float | None) -> bool:
        """Show the newest pose to the monitor, and its age (s) if that counts; return whether a flight stops or pauses."""
        self._looks = self._process.looks
        # A vehicle that repeats its pose needs no setpoints.
        timeout = max(self._params.dynamics.setpoint_timeout, _LEAST_GAP)
        needed = None if self._poses.beats else timeout
        return self.monitor.watch(self._newest, age, needed, self._process.since(self._seen))

    def _on_state(self, state: SafetyState, line: str) -> None:
        self._states.put(state)
        if line:
            self._node.log.info(line)

    def _send_setpoint(self) -> None:
        if self.monitor.situation.boot and not self._deciding:
            self._setpoints.put(self.monitor.setpoint())
            self._sent = time.monotonic()

    def _wait_for_pose(self) -> None:
        # A restart of the hub or the vehicle is no reason to refuse a goal. Only the first of
        # several calls waits: calls that come during the wait are answered from within it.
        if not self._has_pose() and not self._waiting:
            self._waiting = True
            if not self._node.wait_for(self._has_pose, self._params.dynamics.grace):
                self.monitor.lose()
            self._waiting = False

    def _has_pose(self) -> bool:
        """Return whether the newest pose is young enough for a verdict.

        After a delay of this process, before its next tick, the monitor still takes an old one for
        fresh; the pose that shows the delay would then stop the flight that a goal has just begun.
        """
        age = 0.0 if self._is_stepped else time.monotonic() - self._seen - _UNSEEN
        return self.monitor.fresh and age <= self._params.safety.pose_timeout

    def _on_pose(self, pose: Pose) -> None:
        if self.monitor.ignores(pose):
            return
        if (pose.boot, pose.stamp) != (self._newest.boot, self._newest.stamp):
            # A repeated pose is no news of the vehicle.
            if self._looks != self._process.looks and not (self._is_stepped or self._repeats):
                # The newest pose at the last look: answers since then may be those of a delay.
                self._observe(None)
            self._newest, before = pose, self._seen
            self._seen = self._poses.received
            known = not (self._is_stepped or self._repeats) and before
            silence = self._seen - before - _UNSEEN if known else 0.0
            if silence > self._params.safety.pose_timeout:
                # Its own delay: up to now, or earlier in the silence.
                own = max(time.monotonic() - self._process.ticked, self._process.since(before))
                self.monitor.silent(silence, own)
        self._repeats = self._poses.beats is not None
        period = SETPOINT.period(pose.stamp)
        if pose.boot == self.monitor.situation.boot and period == self._answered:
            if pose.seq == self.monitor.pose.seq and time.monotonic() - self._sent > LOST_AFTER:
                # Repeated, so the answer was lost.
                self._send_setpoint()
            return
        self._answered = period
        news = self.monitor.see(pose)
        # The flight goes on with the first answer, which must include all held calls.
        self._deciding = True
        self._node.advance_sim_time(pose.boot, pose.stamp)
        self._deciding = False
        self._send_setpoint()
        if news:
            self._warn()

    def _on_waypoint(self, waypoint: Waypoint) -> None:
        self._poses.poll()
        self.monitor.goto(Position(waypoint.x, waypoint.y, waypoint.z))

    def _goto(self, request: GotoRequest) -> GotoResponse:
        self._wait_for_pose()
        goal = Position(request.x, request.y, request.z)
        before = self.monitor.setpoint()
        reason = self.monitor.goto(
            goal, replace=request.replace, direct=request.direct, wait=request.wait
        )
        if not reason and not before.brake and before.position == goal and before.for_seq:
            # A vehicle that stopped by itself, unseen, would take the goal for the old one. One that did
            # not must not fly on by this before the goal comes: it answers no pose that waits.
            self._setpoints.put(replace(before, brake=True, for_seq=before.for_seq - 1))
        self._send_setpoint()
        return GotoResponse(not reason or reason.startswith(WAITS), reason)

    def _hold(self, _request: HoldRequest) -> HoldResponse:
        if not self.monitor.situation.boot:
            raise NotReady("no pose yet: dynamics is silent")
        self.monitor.hold()
        self._send_setpoint()
        return HoldResponse(True)

    def _toggle_cage(self, request: ToggleCageRequest) -> ToggleCageResponse:
        self.monitor.toggle(cage_on=request.cage_on)
        self._send_setpoint()
        return ToggleCageResponse(self.monitor.situation.cage_on is request.cage_on)


def run(node: Node, params: Params, process: SafetyProcess | None = None) -> None:
    """Step on the poses at 20 Hz; a separate clock checks that they keep coming."""
    _log_launch(node, params)
    services = {service.name: service.node for service in SERVICES}
    topics = {topic.name: topic.node for topic in TOPICS}
    node.publisher(INFO).put(Info(node.vehicle, services, topics))
    safety = Safety(node, params, process or SafetyProcess())
    there = node.wait_for(lambda: safety.monitor.fresh, FIRST_POSE)
    if not there and not node.expects(POSE_SLOW):
        safety.listen_to_all_poses()
    safety.serve()
    safety.run()


def _log_launch(node: Node, params: Params) -> None:
    """Log the lab's lines: the cage as intervals, the rest unchanged."""
    intervals = bounds(params.safety.virtual_cage)
    for line in launch_lines(params.safety, node.reference_params and node.reference_params.safety):
        axis = line.removeprefix("Param: virtual cage ")[:1]
        if line.startswith("Param: virtual cage "):
            low, high = intervals[axis]
            node.log.info("Param: cage %s - [%s, %s]", axis, low, high)
        elif line != "Param: zones - []":
            node.log.info(line)
    if node.restarted:
        node.log.warning("restarted: the cage is on")


if __name__ == "__main__":
    start("safety", partial(run, process=SafetyProcess()), keeps_time=True)
