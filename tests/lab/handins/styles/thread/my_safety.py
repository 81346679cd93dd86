"""Safety with a control thread: it sends setpoints, the main thread serves."""

import threading
import time
from math import hypot

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, POSE, SETPOINT, STATE, TOGGLE_CAGE


class Safety:
    def __init__(self, node: Node, params: Params) -> None:
        self.lock = threading.Lock()  # guards everything below
        self.cage = CageSize(
            params.safety.virtual_cage.x,
            params.safety.virtual_cage.y,
            params.safety.virtual_cage.z,
        )
        self.acceptance_range = params.safety.acceptance_range
        self.home = Position(0, 0, params.safety.takeoff)
        self.pose = None
        self.cage_on = True
        self.requests = 0
        self.take_off()

        self.setpoint_pub = node.publisher(SETPOINT)
        self.state_pub = node.publisher(STATE)
        node.serve(GOTO, self.on_goto)
        node.serve(TOGGLE_CAGE, self.on_toggle)
        node.listen(POSE, self.on_pose)
        self.thread = threading.Thread(target=self.control_loop, daemon=True)
        self.thread.start()

    # ---- with the lock held

    def take_off(self) -> None:
        self.state = "MOVING"
        self.goal = self.home
        self.brake = False
        self.reason = ""

    def publish_state(self) -> None:
        if self.pose is None:
            return
        self.state_pub.put(
            SafetyState(
                self.pose.boot,
                self.pose.stamp,
                self.requests,
                self.state,
                self.goal,
                self.cage_on,
                self.cage,
                self.reason,
            )
        )

    def is_inside(self, p: Position) -> bool:
        c = self.cage
        return abs(p.x) <= c.x and abs(p.y) <= c.y and p.z >= 0 and p.z <= c.z

    # ---- main thread

    def on_pose(self, pose: Pose) -> None:
        with self.lock:
            if self.pose is not None and self.pose.boot != pose.boot:
                self.take_off()
            self.pose = pose

    def on_goto(self, request: GotoRequest) -> GotoResponse:
        with self.lock:
            self.requests += 1
            if self.state != "HOVERING":
                self.reason = "busy"
                self.publish_state()
                return GotoResponse(False, "busy")
            self.state = "VERIFYING"
            self.publish_state()
            goal = Position(request.x, request.y, request.z)
            if goal.z < 0:
                self.reason = "the goal is in the ground"
            elif self.cage_on and not self.is_inside(goal):
                self.reason = "the goal is outside the cage"
            else:
                self.reason = ""
                self.goal = goal
                self.brake = False
            accepted = self.reason == ""
            self.state = "MOVING" if accepted else "HOVERING"
            self.publish_state()
            return GotoResponse(accepted, self.reason)

    def on_toggle(self, request: ToggleCageRequest) -> ToggleCageResponse:
        with self.lock:
            self.cage_on = request.cage_on
            if self.cage_on and self.state == "MOVING" and not self.is_inside(self.goal):
                self.state = "HOVERING"
                self.brake = True
                self.reason = "the cage was turned on"
            self.publish_state()
            return ToggleCageResponse(True)

    # ---- control thread

    def control_loop(self) -> None:
        while True:
            with self.lock:
                if self.pose is not None:
                    self.control_step(self.pose)
            time.sleep(0.02)

    def control_step(self, pose: Pose) -> None:
        if self.state == "MOVING":
            p, g = pose.position, self.goal
            if hypot(p.x - g.x, p.y - g.y, p.z - g.z) < self.acceptance_range:
                self.state = "HOVERING"
        self.setpoint_pub.put(Setpoint(pose.boot, pose.seq, self.goal, self.brake))
        self.publish_state()


def run(node: Node, params: Params) -> None:
    Safety(node, params)
    node.spin()


start("safety", run)
