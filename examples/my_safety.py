"""Checkpoint 2 as a student writes it: your own safety node in place of the built-in one.

Name it in quad.toml:

    [processes]
    safety = "python my_safety.py"

The path is relative to the file's folder. Turning the cage off and holding are left to you.
"""

from math import dist

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, StateName
from quadctl.schemas.services import GotoRequest, GotoResponse
from quadctl.schemas.topics import GOTO, SETPOINT, STATE


def run(node: Node, params: Params) -> None:
    """Verify each requested goal against the cage, and fly to those inside."""
    size, reach = params.safety.virtual_cage, params.safety.acceptance_range
    cage, home = CageSize(size.x, size.y, size.z), Position(0, 0, params.safety.takeoff)
    setpoints, states = node.publisher(SETPOINT), node.publisher(STATE)
    pose: Pose | None = None
    state: StateName = "MOVING"
    goal, count, reason = home, 0, ""

    def publish() -> None:
        if pose is not None:
            states.put(SafetyState(pose.boot, pose.stamp, count, state, goal, True, cage, reason))

    def goto(ask: GotoRequest) -> GotoResponse:
        nonlocal goal, state, count, reason
        before, state, count = state, "VERIFYING", count + 1
        publish()
        inside = abs(ask.x) <= size.x and abs(ask.y) <= size.y and 0 <= ask.z <= size.z
        if inside:
            goal, state, reason = Position(ask.x, ask.y, ask.z), "MOVING", ""
        else:
            state, reason = before, "outside the cage"
        publish()
        return GotoResponse(inside, reason)

    node.serve(GOTO, goto)
    for seen in node.poses():
        if pose is not None and seen.boot != pose.boot:
            goal, state, count, reason = home, "MOVING", 0, ""  # the simulation was reset
        pose, p = seen, seen.position
        if state == "MOVING" and dist((p.x, p.y, p.z), (goal.x, goal.y, goal.z)) < reach:
            state = "HOVERING"
        setpoints.put(Setpoint(pose.boot, pose.seq, goal, brake=False))
        publish()


start("safety", run)
