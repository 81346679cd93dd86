"""A good hand-in: both nodes in one file of plain functions, `python nodes.py safety`."""

import sys

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Position, Pressure, SafetyState, Setpoint
from quadctl.schemas.services import CalibrateResponse, GotoResponse, ToggleCageResponse
from quadctl.schemas.topics import CALIBRATE, GOTO, PRESSURE, SETPOINT, STATE, TOGGLE_CAGE


def safety(node: Node, params: Params) -> None:
    bounds = params.safety.virtual_cage
    size = CageSize(bounds.x, bounds.y, bounds.z)
    walls = {"x": (-size.x, size.x), "y": (-size.y, size.y), "z": (0.0, size.z)}
    states, setpoints = node.publisher(STATE), node.publisher(SETPOINT)
    now = {"state": "MOVING", "goal": Position(0, 0, params.safety.takeoff), "on": True, "n": 0}
    now |= {"pose": None, "brake": False}

    def tell(state, reason=""):
        now["state"] = state
        if now["pose"]:
            pose = now["pose"]
            about = (now["n"], state, now["goal"], now["on"], size, reason)
            states.put(SafetyState(pose.boot, pose.stamp, *about))

    def why_not(goal):
        for axis, (low, high) in walls.items():
            if not low <= getattr(goal, axis) <= high:
                return f"{axis} is not within {low:g} and {high:g}"
        return ""

    def goto(ask):
        before = now["state"]
        now["n"] += 1
        tell("VERIFYING")
        reason = why_not(ask) if now["on"] else "below the floor" if ask.z < 0 else ""
        if reason:
            tell(before, reason)
        else:  # a new goal in flight is welcome here
            now["goal"], now["brake"] = Position(ask.x, ask.y, ask.z), False
            tell("MOVING")
        return GotoResponse(not reason, reason)

    def toggle(ask):
        now["on"] = ask.cage_on
        leaves = ask.cage_on and now["state"] == "MOVING" and why_not(now["goal"])
        now["brake"] = now["brake"] or bool(leaves)
        tell("HOVERING" if leaves else now["state"])
        return ToggleCageResponse(True)

    node.serve(GOTO, goto)
    node.serve(TOGGLE_CAGE, toggle)
    for pose in node.poses():
        if now["pose"] and pose.boot != now["pose"].boot:
            now |= {
                "state": "MOVING",
                "goal": Position(0, 0, params.safety.takeoff),
                "brake": False,
            }
        now["pose"], goal = pose, now["goal"]
        squared = sum((getattr(pose.position, a) - getattr(goal, a)) ** 2 for a in "xyz")
        near = squared**0.5 < params.safety.acceptance_range
        setpoints.put(Setpoint(pose.boot, pose.seq, goal, now["brake"]))
        tell("HOVERING" if now["state"] == "MOVING" and near else now["state"])


def pressure(node: Node, params: Params) -> None:
    readings, baseline, raw = node.publisher(PRESSURE), 0.0, 0.0

    def calibrate(ask):
        nonlocal baseline
        baseline = raw if ask.zero else 0.0
        return CalibrateResponse(baseline)

    node.serve(CALIBRATE, calibrate)
    for pose in node.poses():
        raw = 1013.25 * (1 - 2.25577e-5 * pose.position.z) ** 5.25588
        if pose.seq % 10 == 0:
            readings.put(Pressure(pose.stamp, raw - baseline, baseline, 0, 0.0))


name = sys.argv.pop(1)
start(name, {"safety": safety, "pressure": pressure}[name])
