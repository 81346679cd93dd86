from math import dist
from time import sleep

from quadctl import start
from quadctl.schemas.messages import CageSize, Position, SafetyState, Setpoint
from quadctl.schemas.services import GotoResponse, ToggleCageResponse
from quadctl.schemas.topics import GOTO, SETPOINT, STATE, TOGGLE_CAGE


def run(node, params):
    p = params.safety
    cage = CageSize(p.virtual_cage.x, p.virtual_cage.y, p.virtual_cage.z)
    home = Position(0.0, 0.0, p.takeoff)
    state, goal, brake, reason, cage_on, n, now = "MOVING", home, False, "", True, 0, None
    setpoints, states = node.publisher(SETPOINT), node.publisher(STATE)

    def outside(g):
        return abs(g.x) > cage.x or abs(g.y) > cage.y or g.z > cage.z or g.z < 0

    def to(new):
        nonlocal state
        state = new
        print("STATE", state, goal, "brake", brake, "cage", cage_on, reason, flush=True)
        if now is not None:
            states.put(SafetyState(now.boot, now.stamp, n, state, goal, cage_on, cage, reason))

    def goto(q):
        nonlocal goal, brake, reason, n
        n += 1
        print("GOTO", n, q, "in", state, flush=True)
        if state != "HOVERING":
            reason = "busy, state is " + state
            to(state)
            return GotoResponse(False, reason)
        reason = ""
        to("VERIFYING")
        sleep(0.05)  # so that I see VERIFYING
        g = Position(q.x, q.y, q.z)
        if g.z < 0:
            reason = "below the floor"
        elif cage_on and outside(g):
            reason = "outside the cage"
        else:
            goal, brake = g, False
        print("VERDICT", reason or "ok", flush=True)
        to("HOVERING" if reason else "MOVING")
        return GotoResponse(not reason, reason)

    def toggle(q):
        nonlocal cage_on, brake, reason
        print("TOGGLE", q, flush=True)
        cage_on = q.cage_on
        stop = cage_on and state == "MOVING" and outside(goal)
        if stop:
            brake, reason = True, "stopped by the cage"
        to("HOVERING" if stop else state)
        return ToggleCageResponse(True)

    node.serve(GOTO, goto)
    node.serve(TOGGLE_CAGE, toggle)
    for pose in node.poses():
        if now is not None and now.boot != pose.boot:
            print("RESET", now.boot, "->", pose.boot, flush=True)
            state, goal, brake, reason = "MOVING", home, False, ""
        now, o = pose, pose.position
        d = dist((o.x, o.y, o.z), (goal.x, goal.y, goal.z))
        print("POSE", pose.seq, pose.stamp, o, "distance", d, flush=True)
        setpoints.put(Setpoint(pose.boot, pose.seq, goal, brake))
        to("HOVERING" if state == "MOVING" and d < p.acceptance_range else state)


start("safety", run)
