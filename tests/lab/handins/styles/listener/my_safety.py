"""Safety as an event-driven class: a pose handler and two services, no loop of its own."""

from __future__ import annotations

from enum import Enum
from math import sqrt

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, POSE_SLOW, SETPOINT, STATE, TOGGLE_CAGE


class Mode(Enum):
    HOVERING = "HOVERING"
    VERIFYING = "VERIFYING"
    MOVING = "MOVING"


class Cage:
    def __init__(self, params: Params) -> None:
        size = params.safety.virtual_cage
        self.size = CageSize(size.x, size.y, size.z)
        self.on = True

    def holds(self, point: Position) -> bool:
        size = self.size
        return (
            -size.x <= point.x <= size.x
            and -size.y <= point.y <= size.y
            and 0 <= point.z <= size.z
        )

    def objection(self, point: Position) -> str:
        """Why the point is not allowed now; empty if it is."""
        if point.z < 0:
            return f"below the floor: z = {point.z:g}"
        if self.on and not self.holds(point):
            return f"outside the cage: ({point.x:g}, {point.y:g}, {point.z:g})"
        return ""


class SafetyNode:
    def __init__(self, node: Node, params: Params) -> None:
        self._node = node
        self._cage = Cage(params)
        self._range = params.safety.acceptance_range
        self._home = Position(0, 0, params.safety.takeoff)
        self._pose: Pose | None = None
        self._requests = 0
        self._restart()
        self._setpoints = node.publisher(SETPOINT)
        self._states = node.publisher(STATE)
        node.serve(GOTO, self._handle_goto)
        node.serve(TOGGLE_CAGE, self._handle_toggle)
        node.listen(POSE_SLOW, self._handle_pose)

    def _restart(self) -> None:
        self._mode = Mode.MOVING
        self._goal = self._home
        self._brake = False
        self._reason = ""

    def _enter(self, mode: Mode) -> None:
        self._mode = mode
        self._publish()

    def _handle_goto(self, request: GotoRequest) -> GotoResponse:
        self._requests += 1
        if self._mode is not Mode.HOVERING:
            self._reason = f"busy: {self._mode.value.lower()}"
            self._publish()
            return GotoResponse(False, self._reason)
        self._enter(Mode.VERIFYING)
        goal = Position(request.x, request.y, request.z)
        self._reason = self._cage.objection(goal)
        if self._reason:
            self._enter(Mode.HOVERING)
            return GotoResponse(False, self._reason)
        self._goal = goal
        self._brake = False
        self._enter(Mode.MOVING)
        return GotoResponse(True, "")

    def _handle_toggle(self, request: ToggleCageRequest) -> ToggleCageResponse:
        self._cage.on = request.cage_on
        if self._cage.on and self._mode is Mode.MOVING and not self._cage.holds(self._goal):
            self._brake = True
            self._reason = "stopped: the goal is outside the cage, which is on now"
            if self._pose is not None:  # the point that it holds from now on
                self._goal = self._pose.position
            self._mode = Mode.HOVERING
        self._publish()
        return ToggleCageResponse(True)

    def _handle_pose(self, pose: Pose) -> None:
        self._node.advance_sim_time(pose.boot, pose.stamp)
        if self._pose is not None and self._pose.boot != pose.boot:
            self._restart()
        self._pose = pose
        if self._mode is Mode.MOVING and self._distance(pose.position) < self._range:
            self._mode = Mode.HOVERING
        self._setpoints.put(Setpoint(pose.boot, pose.seq, self._goal, self._brake))
        self._publish()

    def _distance(self, point: Position) -> float:
        goal = self._goal
        return sqrt((point.x - goal.x) ** 2 + (point.y - goal.y) ** 2 + (point.z - goal.z) ** 2)

    def _publish(self) -> None:
        if self._pose is None:
            return
        self._states.put(
            SafetyState(
                boot=self._pose.boot,
                stamp=self._pose.stamp,
                request=self._requests,
                state=self._mode.value,
                goal=self._goal,
                cage_on=self._cage.on,
                cage=self._cage.size,
                reason=self._reason,
            )
        )


def run(node: Node, params: Params) -> None:
    SafetyNode(node, params)
    node.spin()


if __name__ == "__main__":
    start("safety", run)
