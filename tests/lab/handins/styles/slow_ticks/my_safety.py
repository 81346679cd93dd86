"""Safety node with a control loop of 10 Hz: a listener keeps the newest pose, the loop answers it."""

import math

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, StateName
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, POSE_SLOW, SETPOINT, STATE, TOGGLE_CAGE

RATE = 10  # Hz


class SafetyNode:
    def __init__(self, node: Node, params: Params) -> None:
        self.node = node
        self.cage = CageSize(
            params.safety.virtual_cage.x,
            params.safety.virtual_cage.y,
            params.safety.virtual_cage.z,
        )
        self.acceptance_range = params.safety.acceptance_range
        self.home = Position(0.0, 0.0, params.safety.takeoff)

        self.newest: Pose | None = None
        self.cage_on = True
        self.requests = 0
        self.start_over()

        self.pub_setpoint = node.publisher(SETPOINT)
        self.pub_state = node.publisher(STATE)
        node.listen(POSE_SLOW, self.pose_callback)
        node.serve(GOTO, self.goto_callback)
        node.serve(TOGGLE_CAGE, self.toggle_callback)

    def start_over(self) -> None:
        self.state: StateName = "MOVING"
        self.goal = self.home
        self.brake = False
        self.reason = ""

    # callbacks

    def pose_callback(self, pose: Pose) -> None:
        # Here and not in the loop: a goal may come between a reset and the next tick.
        if self.newest is not None and pose.boot != self.newest.boot:
            self.start_over()
        self.newest = pose
        self.node.advance_sim_time(pose.boot, pose.stamp)

    def goto_callback(self, request: GotoRequest) -> GotoResponse:
        if self.state != "HOVERING":
            return GotoResponse(False, "busy: wait until the vehicle hovers")
        self.requests += 1
        self.set_state("VERIFYING")
        wanted = Position(request.x, request.y, request.z)
        if wanted.z < 0:
            self.reason = "the goal is below the floor"
        elif self.cage_on and not self.in_cage(wanted):
            self.reason = "the goal is outside the cage"
        else:
            self.reason = ""
            self.goal = wanted
            self.brake = False
            self.set_state("MOVING")
            return GotoResponse(True, "")
        self.set_state("HOVERING")
        return GotoResponse(False, self.reason)

    def toggle_callback(self, request: ToggleCageRequest) -> ToggleCageResponse:
        self.cage_on = request.cage_on
        if self.cage_on and self.state == "MOVING" and not self.in_cage(self.goal):
            self.brake = True
            self.reason = "stopped, as the cage is on and the goal outside"
            self.state = "HOVERING"
            self.answer()  # brake now, not only at the next tick
        self.publish_state()
        return ToggleCageResponse(True)

    # helpers

    def in_cage(self, p: Position) -> bool:
        c = self.cage
        return abs(p.x) <= c.x and abs(p.y) <= c.y and 0 <= p.z <= c.z

    def set_state(self, state: StateName) -> None:
        self.state = state
        self.publish_state()

    def answer(self) -> None:
        if self.newest is not None:
            self.pub_setpoint.put(
                Setpoint(self.newest.boot, self.newest.seq, self.goal, self.brake)
            )

    def publish_state(self) -> None:
        if self.newest is not None:
            self.pub_state.put(
                SafetyState(
                    self.newest.boot,
                    self.newest.stamp,
                    self.requests,
                    self.state,
                    self.goal,
                    self.cage_on,
                    self.cage,
                    self.reason,
                )
            )

    # the loop

    def tick(self) -> None:
        pose = self.newest
        if pose is None:
            return
        if self.state == "MOVING":
            here = (pose.position.x, pose.position.y, pose.position.z)
            there = (self.goal.x, self.goal.y, self.goal.z)
            if math.dist(here, there) < self.acceptance_range:
                self.state = "HOVERING"
        self.answer()
        self.publish_state()


def run(node: Node, params: Params) -> None:
    safety = SafetyNode(node, params)
    for _ in node.ticks(RATE):
        safety.tick()


start("safety", run)
