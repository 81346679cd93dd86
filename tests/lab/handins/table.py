"""A good hand-in: the automaton as a table from state and event to an action."""

import math
from dataclasses import dataclass, field

import numpy as np
from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Position, SafetyState, Setpoint
from quadctl.schemas.services import GotoResponse, ToggleCageResponse
from quadctl.schemas.topics import GOTO, SETPOINT, STATE, TOGGLE_CAGE


@dataclass
class Automaton:
    low: np.ndarray
    high: np.ndarray
    reach: float
    home: np.ndarray
    state: str = "MOVING"
    reason: str = ""
    on: bool = True
    stopped: bool = False
    seen: list = field(default_factory=list)

    def __post_init__(self):
        self.goal, self.place = self.home, np.full(3, math.nan)
        self.table = {
            ("HOVERING", "ask"): self.verify,
            ("VERIFYING", "good"): self.depart,
            ("VERIFYING", "bad"): self.stay,
            ("MOVING", "ask"): self.busy,
            ("MOVING", "near"): self.hover,
            ("MOVING", "shut out"): self.stop,
        }

    def event(self, name, *more):
        action = self.table.get((self.state, name))
        if action:
            action(*more)
            self.seen.append(self.state)

    def fits(self, point):
        return point[2] >= 0 and (
            not self.on or bool(np.all((self.low <= point) & (point <= self.high)))
        )

    def verify(self, point):
        self.state = "VERIFYING"
        self.seen.append("VERIFYING")
        self.event("good" if self.fits(point) else "bad", point)

    def depart(self, point):
        self.state, self.goal, self.reason, self.stopped = "MOVING", point, "", False

    def stay(self, _point):
        self.state, self.reason = "HOVERING", "not within the walls"

    def busy(self, _point):
        self.reason = "wait for the arrival"

    def hover(self):
        self.state = "HOVERING"

    def stop(self):
        self.state, self.reason, self.stopped = "HOVERING", "the cage shut", True


def run(node: Node, params: Params) -> None:
    size = params.safety.virtual_cage
    high = np.array([size.x, size.y, size.z])
    home = np.array([0.0, 0.0, params.safety.takeoff])
    low = high * [-1, -1, 0]

    def fresh():
        return Automaton(low, high, params.safety.acceptance_range, home)

    automaton, pose, asked = fresh(), None, 0
    states, setpoints = node.publisher(STATE), node.publisher(SETPOINT)
    cage = CageSize(*high.tolist())

    def publish():
        for state in [*automaton.seen, automaton.state]:
            goal = Position(*automaton.goal.tolist())
            about = (asked, state, goal, automaton.on, cage, automaton.reason)
            if pose is not None:
                states.put(SafetyState(pose.boot, pose.stamp, *about))
        automaton.seen.clear()

    def goto(ask):
        nonlocal asked
        asked += 1
        point = np.array([ask.x, ask.y, ask.z])
        automaton.event("ask", point)
        accepted = automaton.goal is point
        publish()
        return GotoResponse(accepted, "" if accepted else automaton.reason)

    def toggle(ask):
        automaton.on = ask.cage_on
        if not automaton.fits(automaton.goal):
            automaton.event("shut out")
        publish()
        return ToggleCageResponse(True)

    node.serve(GOTO, goto)
    node.serve(TOGGLE_CAGE, toggle)
    for pose_now in node.poses():
        if pose is not None and pose_now.boot != pose.boot:
            on, automaton = automaton.on, fresh()
            automaton.on = on
        pose, p = pose_now, pose_now.position
        if np.linalg.norm(np.array([p.x, p.y, p.z]) - automaton.goal) < automaton.reach:
            automaton.event("near")
        goal = Position(*automaton.goal.tolist())
        setpoints.put(Setpoint(pose.boot, pose.seq, goal, automaton.stopped))
        publish()


start("safety", run)
