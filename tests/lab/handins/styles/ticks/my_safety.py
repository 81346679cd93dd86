# Lab: safety. Polls the newest pose at 20 Hz.
from math import dist

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Position, SafetyState, Setpoint
from quadctl.schemas.services import GotoResponse, ToggleCageResponse
from quadctl.schemas.topics import GOTO, POSE, SETPOINT, STATE, TOGGLE_CAGE


def xyz(p):
    return p.x, p.y, p.z


class Safety:
    def __init__(self, node: Node, params: Params):
        c = params.safety.virtual_cage
        self.cage = CageSize(c.x, c.y, c.z)
        self.acceptance_range = params.safety.acceptance_range
        self.home = Position(0.0, 0.0, params.safety.takeoff)
        self.setpoints = node.publisher(SETPOINT)
        self.states = node.publisher(STATE)
        self.cage_on = True
        self.requests = 0
        self.pose = None
        self.take_off()
        node.serve(GOTO, self.on_goto)
        node.serve(TOGGLE_CAGE, self.on_toggle)

    def take_off(self):
        self.state = "MOVING"
        self.goal = self.home
        self.brake = False
        self.reason = ""

    def change(self, state):
        self.state = state
        self.publish()

    def inside(self, p):
        return abs(p.x) <= self.cage.x and abs(p.y) <= self.cage.y and 0 <= p.z <= self.cage.z

    def on_goto(self, request):
        if self.state != "HOVERING":
            return GotoResponse(False, "busy, wait until I hover")
        self.requests += 1
        self.change("VERIFYING")
        goal = Position(request.x, request.y, request.z)
        ok = goal.z >= 0 and (not self.cage_on or self.inside(goal))
        if ok:
            self.goal, self.brake, self.reason = goal, False, ""
            self.change("MOVING")
        else:
            self.reason = "below the floor" if goal.z < 0 else "not in the cage"
            self.change("HOVERING")
        return GotoResponse(ok, self.reason)

    def on_toggle(self, request):
        self.cage_on = request.cage_on
        if self.cage_on and self.state == "MOVING" and not self.inside(self.goal):
            self.brake, self.reason = True, "stopped at the cage"
            self.state = "HOVERING"
        self.publish()
        return ToggleCageResponse(True)

    def step(self, pose):
        if self.pose is not None and self.pose.boot != pose.boot:
            self.take_off()
        self.pose = pose
        if self.state == "MOVING":
            if dist(xyz(pose.position), xyz(self.goal)) < self.acceptance_range:
                self.state = "HOVERING"
        self.setpoints.put(Setpoint(pose.boot, pose.seq, self.goal, self.brake))
        self.publish()

    def publish(self):
        p = self.pose
        if p is None:
            return
        self.states.put(SafetyState(p.boot, p.stamp, self.requests, self.state, self.goal,
                                    self.cage_on, self.cage, self.reason))


def run(node: Node, params: Params):
    safety = Safety(node, params)
    sub = node.listen(POSE)
    for _ in node.ticks(20):
        pose = sub.value
        if pose is None:
            continue
        node.advance_sim_time(pose.boot, pose.stamp)
        safety.step(pose)


start("safety", run)
