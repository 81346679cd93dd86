"""Safety node with its own queue of poses, and numpy for the geometry."""

from collections import deque

import numpy as np

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, POSE_SLOW, SETPOINT, STATE, TOGGLE_CAGE


def vec(p) -> np.ndarray:
    """Anything with x, y, z -> vector."""
    return np.array([p.x, p.y, p.z], dtype=float)


def pos(v: np.ndarray) -> Position:
    """Vector -> message; tolist() because a message wants Python's own floats."""
    return Position(*v.tolist())


class Safety:
    def __init__(self, node: Node, params: Params):
        size = params.safety.virtual_cage
        self.cage = CageSize(size.x, size.y, size.z)
        self.low = np.array([-size.x, -size.y, 0.0])
        self.high = np.array([size.x, size.y, size.z])
        self.eps = params.safety.acceptance_range
        self.home = np.array([0.0, 0.0, params.safety.takeoff])
        self.cage_on = True
        self.requests = 0
        self.pose: Pose | None = None
        self.begin()
        self.setpoints = node.publisher(SETPOINT)
        self.states = node.publisher(STATE)
        node.serve(GOTO, self.on_goto)
        node.serve(TOGGLE_CAGE, self.on_toggle)

    def begin(self):
        self.state, self.goal, self.brake, self.reason = "MOVING", self.home, False, ""

    def inside(self, v: np.ndarray) -> bool:
        return bool(np.all((self.low <= v) & (v <= self.high)))

    def on_goto(self, request: GotoRequest) -> GotoResponse:
        self.requests += 1
        if self.state != "HOVERING":
            self.reason = f"busy: {self.state.lower()}"
            self.publish()
            return GotoResponse(False, self.reason)
        self.set("VERIFYING", "")
        goal = vec(request)
        if goal[2] < 0:
            self.set("HOVERING", "below the floor")
        elif self.cage_on and not self.inside(goal):
            axes = [a for a, l, v, h in zip("xyz", self.low, goal, self.high) if not l <= v <= h]
            self.set("HOVERING", "outside the cage in " + ", ".join(axes))
        else:
            self.goal, self.brake = goal, False
            self.set("MOVING", "")
        return GotoResponse(self.state == "MOVING", self.reason)

    def on_toggle(self, request: ToggleCageRequest) -> ToggleCageResponse:
        self.cage_on = request.cage_on
        if self.cage_on and self.state == "MOVING" and not self.inside(self.goal):
            self.brake = True
            if self.pose is not None:
                self.goal = vec(self.pose.position)
            self.set("HOVERING", "stopped: the cage came on")
        else:
            self.publish()
        return ToggleCageResponse(True)

    def on_pose(self, pose: Pose):
        if self.pose is not None and pose.boot != self.pose.boot:
            self.begin()
        self.pose = pose
        if self.state == "MOVING" and np.linalg.norm(vec(pose.position) - self.goal) < self.eps:
            self.state = "HOVERING"
        self.setpoints.put(Setpoint(pose.boot, pose.seq, pos(self.goal), self.brake))
        self.publish()

    def set(self, state, reason):
        self.state, self.reason = state, reason
        self.publish()

    def publish(self):
        if self.pose is None:
            return
        self.states.put(
            SafetyState(
                self.pose.boot, self.pose.stamp, self.requests, self.state, pos(self.goal),
                self.cage_on, self.cage, self.reason,
            )
        )


def run(node: Node, params: Params) -> None:
    safety = Safety(node, params)
    queue: deque[Pose] = deque()
    node.listen(POSE_SLOW, queue.append)
    node.ready()
    while not node.stopping:
        node.wait_for(lambda: bool(queue), 0.1)
        while queue:
            pose = queue.popleft()
            node.advance_sim_time(pose.boot, pose.stamp)
            safety.on_pose(pose)


start("safety", run)
