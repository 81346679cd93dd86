"""Safety node, lab hand-in (coming from rospy)."""

import math
import time

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, StateName
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, SETPOINT, STATE, TOGGLE_CAGE

RATE = 20  # Hz, as rospy.Rate(20)


class Safety:
    """State of the automaton: HOVERING, VERIFYING or MOVING."""

    def __init__(self, node: Node, params: Params) -> None:
        # TODO 1
        box = params.safety.virtual_cage
        self.cage = CageSize(box.x, box.y, box.z)
        self.acceptance_range = params.safety.acceptance_range
        node.log.info("cage %g %g %g, range %g", box.x, box.y, box.z, self.acceptance_range)

        self.home = Position(0, 0, params.safety.takeoff)
        self.setpoints, self.states = node.publisher(SETPOINT), node.publisher(STATE)
        self.cage_on = True
        self.requests = 0
        self.pose: Pose | None = None
        self.take_off()
        node.serve(GOTO, self.on_goto)
        node.serve(TOGGLE_CAGE, self.on_toggle)

    def take_off(self) -> None:
        """Begin anew, after the start and after each reset of the simulation."""
        self.state: StateName = "MOVING"
        self.goal, self.brake, self.reason = self.home, False, ""

    def in_cage(self, p: Position) -> bool:
        """Walls belong to the cage."""
        if p.x < -self.cage.x or p.x > self.cage.x:
            return False
        if p.y < -self.cage.y or p.y > self.cage.y:
            return False
        if p.z < 0 or p.z > self.cage.z:
            return False
        return True

    def on_goto(self, request: GotoRequest) -> GotoResponse:
        """Answer a requested goal: accept it, or refuse it with a reason."""
        # TODO 2
        self.requests += 1
        if self.state != "HOVERING":
            self.publish()
            return GotoResponse(False, "busy: still " + self.state)
        self.state = "VERIFYING"
        self.publish()
        goal = Position(request.x, request.y, request.z)
        if goal.z < 0:
            self.reason = "z is below the floor"
        elif self.cage_on and not self.in_cage(goal):
            self.reason = "outside of the virtual cage"
        else:
            self.reason = ""
        if self.reason != "":
            self.state = "HOVERING"
            self.publish()
            return GotoResponse(False, self.reason)
        self.goal = goal
        self.brake = False
        self.state = "MOVING"
        self.publish()
        return GotoResponse(True, "")

    def on_toggle(self, request: ToggleCageRequest) -> ToggleCageResponse:
        """Turn the cage on or off."""
        # TODO 4
        self.cage_on = request.cage_on
        if self.cage_on and self.state == "MOVING" and not self.in_cage(self.goal):
            self.brake = True
            self.state = "HOVERING"
            self.reason = "cage came on, goal is outside"
        self.publish()
        return ToggleCageResponse(True)

    def on_pose(self, pose: Pose) -> None:
        """Follow the vehicle, and answer its pose with a setpoint."""
        if self.pose is not None and pose.boot != self.pose.boot:
            self.take_off()
        self.pose = pose
        if self.state == "MOVING":
            dx = pose.position.x - self.goal.x
            dy = pose.position.y - self.goal.y
            dz = pose.position.z - self.goal.z
            if math.sqrt(dx * dx + dy * dy + dz * dz) < self.acceptance_range:
                self.state = "HOVERING"
        self.setpoints.put(Setpoint(pose.boot, pose.seq, self.goal, self.brake))
        self.publish()

    def publish(self) -> None:
        """Publish the state."""
        if self.pose is not None:
            self.states.put(
                SafetyState(
                    self.pose.boot, self.pose.stamp, self.requests, self.state, self.goal,
                    self.cage_on, self.cage, self.reason,
                )
            )  # fmt: skip


def run(node: Node, params: Params) -> None:
    """Answer each pose, 20 a second."""
    safety = Safety(node, params)
    for pose in node.poses():
        safety.on_pose(pose)
        time.sleep(1 / RATE)  # rate.sleep()


start("safety", run)
