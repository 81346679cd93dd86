"""Safety node. The automaton is stepped in the loop, once per pose, as in the diagram of the lab:

    take-off -> MOVING -> HOVERING -> VERIFYING -> MOVING or HOVERING

The services only note what was asked. The step at the next pose takes the decision.
"""

from dataclasses import dataclass
from math import sqrt

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, StateName
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, SETPOINT, STATE, TOGGLE_CAGE


@dataclass
class Pending:
    """The goal under verification, and the verdict that its sender was told ("" = accepted)."""

    goal: Position
    verdict: str


class Safety:
    def __init__(self, node: Node, params: Params) -> None:
        size = params.safety.virtual_cage
        self.cage = CageSize(size.x, size.y, size.z)
        self.acceptance_range = params.safety.acceptance_range
        self.home = Position(0.0, 0.0, params.safety.takeoff)
        self.setpoints = node.publisher(SETPOINT)
        self.states = node.publisher(STATE)
        self.cage_on = True
        self.requests = 0
        self.pose: Pose | None = None
        self.take_off()
        node.serve(GOTO, self.on_goto)
        node.serve(TOGGLE_CAGE, self.on_toggle)

    def take_off(self) -> None:
        self.state: StateName = "MOVING"
        self.goal = self.home
        self.brake = False
        self.reason = ""
        self.pending: Pending | None = None

    # ---- verification

    def is_outside(self, p: Position) -> bool:
        inside = (
            -self.cage.x <= p.x <= self.cage.x
            and -self.cage.y <= p.y <= self.cage.y
            and 0 <= p.z <= self.cage.z
        )
        return not inside

    def verify(self, p: Position) -> str:
        """Return why the goal is refused, or "" if it is fine."""
        if p.z < 0:
            return f"below the floor: z = {p.z:g}"
        if self.cage_on and self.is_outside(p):
            return f"outside the cage: ({p.x:g}, {p.y:g}, {p.z:g})"
        return ""

    # ---- services: no decisions here

    def on_goto(self, request: GotoRequest) -> GotoResponse:
        self.requests += 1
        if self.state != "HOVERING":
            busy = f"busy: {self.state}"
            if self.state == "MOVING":
                self.reason = busy
            self.publish()
            return GotoResponse(False, busy)
        goal = Position(request.x, request.y, request.z)
        self.pending = Pending(goal, self.verify(goal))
        self.reason = ""
        self.change("VERIFYING")
        return GotoResponse(self.pending.verdict == "", self.pending.verdict)

    def on_toggle(self, request: ToggleCageRequest) -> ToggleCageResponse:
        self.cage_on = request.cage_on
        # In VERIFYING the loop looks at the cage again once it is MOVING.
        self.stop_if_outside()
        self.publish()
        return ToggleCageResponse(True)

    # ---- loop

    def stop_if_outside(self) -> None:
        if self.state == "MOVING" and self.cage_on and self.is_outside(self.goal):
            self.brake = True
            self.reason = "stopped: the cage came on, and the goal is outside"
            self.state = "HOVERING"

    def on_pose(self, pose: Pose) -> None:
        if self.pose is not None and self.pose.boot != pose.boot:
            self.take_off()
        self.pose = pose
        if self.state == "VERIFYING" and self.pending is not None:
            pending, self.pending = self.pending, None
            if pending.verdict:
                self.reason = pending.verdict
                self.state = "HOVERING"
            else:
                self.goal, self.brake, self.reason = pending.goal, False, ""
                self.change("MOVING")
                self.stop_if_outside()  # the cage may have come on since
        elif self.state == "MOVING" and self.distance(pose.position) < self.acceptance_range:
            self.state = "HOVERING"
        self.setpoints.put(Setpoint(pose.boot, pose.seq, self.goal, self.brake))
        self.publish()

    def distance(self, p: Position) -> float:
        g = self.goal
        return sqrt((p.x - g.x) ** 2 + (p.y - g.y) ** 2 + (p.z - g.z) ** 2)

    def change(self, state: StateName) -> None:
        self.state = state
        self.publish()

    def publish(self) -> None:
        if self.pose is None:
            return
        self.states.put(
            SafetyState(
                boot=self.pose.boot,
                stamp=self.pose.stamp,
                request=self.requests,
                state=self.state,
                goal=self.goal,
                cage_on=self.cage_on,
                cage=self.cage,
                reason=self.reason,
            )
        )


def run(node: Node, params: Params) -> None:
    safety = Safety(node, params)
    for pose in node.poses():
        safety.on_pose(pose)


start("safety", run)
