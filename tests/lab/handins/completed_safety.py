"""A good hand-in: the starter, completed."""

from math import dist

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, StateName
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, SETPOINT, STATE, TOGGLE_CAGE


class Safety:
    def __init__(self, node: Node, params: Params) -> None:
        size = params.safety.virtual_cage
        self.cage = CageSize(size.x, size.y, size.z)
        self.acceptance_range = params.safety.acceptance_range
        self.home = Position(0, 0, params.safety.takeoff)
        self.setpoints, self.states = node.publisher(SETPOINT), node.publisher(STATE)
        self.requests = 0
        self.pose: Pose | None = None
        self.cage_on = True
        self.take_off()
        node.serve(GOTO, self.on_goto)
        node.serve(TOGGLE_CAGE, self.on_toggle)

    def take_off(self) -> None:
        self.state: StateName = "MOVING"
        self.goal, self.brake, self.reason = self.home, False, ""

    def is_inside(self, point: Position) -> bool:
        # The floor holds with the cage off, too: on_goto looks at it.
        cage = self.cage
        return abs(point.x) <= cage.x and abs(point.y) <= cage.y and point.z <= cage.z

    def on_goto(self, request: GotoRequest) -> GotoResponse:
        if self.state != "HOVERING":
            return GotoResponse(False, "busy: flying to another goal")
        goal = Position(request.x, request.y, request.z)
        self.requests += 1
        self.state = "VERIFYING"
        self.publish()
        if goal.z < 0 or (self.cage_on and not self.is_inside(goal)):
            self.state, self.reason = "HOVERING", "outside the cage"
            self.publish()
            return GotoResponse(False, self.reason)
        self.state, self.goal, self.brake, self.reason = "MOVING", goal, False, ""
        self.publish()
        return GotoResponse(True, "")

    def on_toggle(self, request: ToggleCageRequest) -> ToggleCageResponse:
        self.cage_on = request.cage_on
        if self.cage_on and self.state == "MOVING" and not self.is_inside(self.goal):
            self.state, self.brake, self.reason = "HOVERING", True, "stopped: the cage is on"
        self.publish()
        return ToggleCageResponse(True)

    def on_pose(self, pose: Pose) -> None:
        if self.pose is not None and pose.boot != self.pose.boot:
            self.take_off()
        self.pose = pose
        place = pose.position
        away = dist((place.x, place.y, place.z), (self.goal.x, self.goal.y, self.goal.z))
        if self.state == "MOVING" and away < self.acceptance_range:
            self.state = "HOVERING"
        self.setpoints.put(Setpoint(pose.boot, pose.seq, self.goal, self.brake))
        self.publish()

    def publish(self) -> None:
        if self.pose is not None:
            self.states.put(
                SafetyState(
                    self.pose.boot, self.pose.stamp, self.requests, self.state, self.goal,
                    self.cage_on, self.cage, self.reason,
                )
            )  # fmt: skip


def run(node: Node, params: Params) -> None:
    safety = Safety(node, params)
    for pose in node.poses():
        safety.on_pose(pose)


start("safety", run)
