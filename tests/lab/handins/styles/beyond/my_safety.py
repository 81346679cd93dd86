"""Safety node with all that the lab's text asks: printed and live parameters, waypoints, own types."""

from math import dist

from msgspec import Struct

from quadctl import Node, Params, Service, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, Waypoint
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, REQUEST, SETPOINT, STATE, TOGGLE_CAGE


class ToggleRequest(Struct):
    cage_on: bool


class ToggleResponse(Struct):
    success: bool


TOGGLE = Service("own/toggle", ToggleRequest, ToggleResponse, node="safety", doc="My cage's switch.")


class SafetyNode:
    def __init__(self, node: Node, params: Params) -> None:
        self.params = params.safety
        self.print_params()
        self.setpoints = node.publisher(SETPOINT)
        self.states = node.publisher(STATE)
        self.pose = None
        self.cage_on = True
        self.requests = 0
        self.state = ""
        self.reset()
        node.serve(GOTO, self.goto)
        node.serve(TOGGLE_CAGE, self.toggle)
        node.serve(TOGGLE, self.own_toggle)
        node.listen(REQUEST, self.waypoint)
        for pose in node.poses():
            self.step(pose)

    def print_params(self) -> None:
        cage = self.params.virtual_cage
        print("/state_safety_node: Launching with the following parameters:")
        print(f"Param: cage x - [{-cage.x}, {cage.x}]")
        print(f"Param: cage y - [{-cage.y}, {cage.y}]")
        print(f"Param: cage z - [0, {cage.z}]")
        print(f"Param: acceptance range - {self.params.acceptance_range}")

    def reset(self) -> None:
        self.goal, self.brake, self.reason = Position(0, 0, self.params.takeoff), False, ""
        self.change("MOVING")

    def change(self, state: str) -> None:
        if state != self.state:
            print("Current State:", state)
        self.state = state
        self.publish()

    def verify(self, x: float, y: float, z: float) -> str:
        """Return why a goal is refused, or nothing."""
        if self.state != "HOVERING":
            return "busy"
        self.requests += 1
        self.change("VERIFYING")
        print(f"Requested position: {x} {y} {z}")
        cage = self.params.virtual_cage
        inside = abs(x) <= cage.x and abs(y) <= cage.y and z <= cage.z
        if z >= 0 and (inside or not self.cage_on):
            self.goal, self.brake, self.reason = Position(x, y, z), False, ""
            self.change("MOVING")
        else:
            self.reason = "outside the cage"
            self.change("HOVERING")
        return self.reason

    def goto(self, request: GotoRequest) -> GotoResponse:
        reason = self.verify(request.x, request.y, request.z)
        return GotoResponse(not reason, reason)

    def waypoint(self, message: Waypoint) -> None:
        self.verify(message.x, message.y, message.z)

    def set_cage(self, on: bool) -> None:
        self.cage_on = on
        cage, goal = self.params.virtual_cage, self.goal
        outside = abs(goal.x) > cage.x or abs(goal.y) > cage.y or goal.z > cage.z
        if on and outside and self.state == "MOVING":
            self.brake, self.reason = True, "the cage came on"
            self.change("HOVERING")
        self.publish()

    def toggle(self, request: ToggleCageRequest) -> ToggleCageResponse:
        self.set_cage(request.cage_on)
        return ToggleCageResponse(True)

    def own_toggle(self, request: ToggleRequest) -> ToggleResponse:
        self.set_cage(request.cage_on)
        return ToggleResponse(True)

    def step(self, pose: Pose) -> None:
        if self.pose and self.pose.boot != pose.boot:
            self.pose = None
            self.reset()
        self.pose = pose
        here = pose.position
        away = dist((here.x, here.y, here.z), (self.goal.x, self.goal.y, self.goal.z))
        if self.state == "MOVING" and away < self.params.acceptance_range:
            self.change("HOVERING")
        self.setpoints.put(Setpoint(pose.boot, pose.seq, self.goal, self.brake))
        self.publish()

    def publish(self) -> None:
        if self.pose is None:
            return
        size = self.params.virtual_cage
        self.states.put(
            SafetyState(
                self.pose.boot, self.pose.stamp, self.requests, self.state, self.goal,
                self.cage_on, CageSize(size.x, size.y, size.z), self.reason,
            )
        )


start("safety", SafetyNode)
