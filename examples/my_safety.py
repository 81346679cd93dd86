"""Checkpoint 2 as a student writes it: your own safety node in place of the built-in one.

Name it in quad.toml:

    [processes]
    safety = "python examples/my_safety.py"

The path is relative to the file's folder. Turning the cage off and holding are left to you.
"""

from math import dist

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Position, SafetyState, Setpoint
from quadctl.schemas.services import GotoRequest, GotoResponse
from quadctl.schemas.topics import GOTO, POSE, SETPOINT, STATE


def run(node: Node, params: Params) -> None:
    """Accept goals in the cage, and fly to them."""
    size, reach = params.safety.virtual_cage, params.safety.acceptance_range
    pose, setpoints, states = node.listen(POSE), node.publisher(SETPOINT), node.publisher(STATE)
    goal, state, count, reason = Position(0, 0, params.safety.takeoff), "MOVING", 0, ""

    def goto(ask: GotoRequest) -> GotoResponse:
        nonlocal goal, state, count, reason
        inside = abs(ask.x) <= size.x and abs(ask.y) <= size.y and 0 <= ask.z <= size.z
        reason = "" if inside else "outside the cage"
        if inside:
            goal, state, count = Position(ask.x, ask.y, ask.z), "MOVING", count + 1
        return GotoResponse(inside, reason)

    node.serve(GOTO, goto)
    for _ in node.ticks(SETPOINT.hz):
        if (seen := pose.value) is None:
            continue
        here = (seen.position.x, seen.position.y, seen.position.z)
        if dist(here, (goal.x, goal.y, goal.z)) < reach:
            state = "HOVERING"
        setpoints.put(Setpoint(seen.boot, seen.seq, goal, brake=False))
        cage = CageSize(size.x, size.y, size.z)
        states.put(SafetyState(seen.boot, seen.stamp, count, state, goal, True, cage, reason))


start("safety", run)
