"""Safety as pure functions: (automaton, event) -> automaton; the effects are at the edge, in run."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import dist
from time import sleep

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, StateName
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, SETPOINT, STATE, TOGGLE_CAGE

VERIFICATION = 0.03  # s


@dataclass(frozen=True)
class Requested:
    pass


@dataclass(frozen=True)
class Approved:
    goal: Position


@dataclass(frozen=True)
class Rejected:
    reason: str


@dataclass(frozen=True)
class Arrived:
    pass


@dataclass(frozen=True)
class Stopped:
    reason: str


Event = Requested | Approved | Rejected | Arrived | Stopped

TABLE: dict[tuple[StateName, type], StateName] = {
    ("HOVERING", Requested): "VERIFYING",
    ("VERIFYING", Approved): "MOVING",
    ("VERIFYING", Rejected): "HOVERING",
    ("MOVING", Arrived): "HOVERING",
    ("MOVING", Stopped): "HOVERING",
}


@dataclass(frozen=True)
class Automaton:
    goal: Position
    cage_on: bool
    state: StateName = "MOVING"
    brake: bool = False
    reason: str = ""
    requests: int = 0


def may(automaton: Automaton, kind: type) -> bool:
    return (automaton.state, kind) in TABLE


def after(automaton: Automaton, event: Event) -> Automaton:
    """The automaton after an event that it may take."""
    moved = replace(automaton, state=TABLE[automaton.state, type(event)])
    match event:
        case Approved(goal):
            return replace(moved, goal=goal, brake=False, reason="")
        case Rejected(reason):
            return replace(moved, reason=reason)
        case Stopped(reason):
            return replace(moved, brake=True, reason=reason)
        case _:
            return moved


def within(cage: CageSize) -> Callable[[Position], bool]:
    limits = (("x", -cage.x, cage.x), ("y", -cage.y, cage.y), ("z", 0.0, cage.z))
    return lambda point: all(low <= getattr(point, axis) <= high for axis, low, high in limits)


def verdict(goal: Position, *, cage_on: bool, inside: Callable[[Position], bool]) -> Event:
    match (goal.z >= 0, cage_on, inside(goal)):
        case (False, _, _):
            return Rejected("the floor is at z = 0")
        case (True, True, False):
            return Rejected("the goal is beyond a wall of the cage")
        case _:
            return Approved(goal)


def distance(a: Position, b: Position) -> float:
    return dist((a.x, a.y, a.z), (b.x, b.y, b.z))


def run(node: Node, params: Params) -> None:
    size = params.safety.virtual_cage
    cage = CageSize(size.x, size.y, size.z)
    reach, inside = params.safety.acceptance_range, within(cage)
    home = Position(0, 0, params.safety.takeoff)
    setpoints, states = node.publisher(SETPOINT), node.publisher(STATE)
    now = Automaton(home, params.safety.cage_on)
    pose: Pose | None = None

    def become(automaton: Automaton) -> None:
        nonlocal now
        now = automaton
        if pose is not None:
            states.put(
                SafetyState(
                    pose.boot,
                    pose.stamp,
                    now.requests,
                    now.state,
                    now.goal,
                    now.cage_on,
                    cage,
                    now.reason,
                )
            )

    def goto(request: GotoRequest) -> GotoResponse:
        counted = replace(now, requests=now.requests + 1)
        if not may(counted, Requested):
            become(replace(counted, reason=f"busy: {counted.state}"))
            return GotoResponse(False, now.reason)
        become(after(counted, Requested()))
        sleep(VERIFICATION)
        goal = Position(request.x, request.y, request.z)
        become(after(now, verdict(goal, cage_on=now.cage_on, inside=inside)))
        return GotoResponse(now.state == "MOVING", now.reason)

    def toggle(request: ToggleCageRequest) -> ToggleCageResponse:
        toggled = replace(now, cage_on=request.cage_on)
        if toggled.cage_on and may(toggled, Stopped) and not inside(toggled.goal):
            toggled = after(toggled, Stopped("the cage is on, and the goal outside"))
        become(toggled)
        return ToggleCageResponse(now.cage_on == request.cage_on)

    node.serve(GOTO, goto)
    node.serve(TOGGLE_CAGE, toggle)
    for seen in node.poses():
        following = now
        if pose is not None and pose.boot != seen.boot:
            following = Automaton(home, now.cage_on, requests=now.requests)
        pose = seen
        if may(following, Arrived) and distance(pose.position, following.goal) < reach:
            following = after(following, Arrived())
        setpoints.put(Setpoint(pose.boot, pose.seq, following.goal, following.brake))
        become(following)


start("safety", run)
