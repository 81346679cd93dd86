"""Safety node after the State pattern (Gamma et al.): each state is a class, Automaton the context."""

from __future__ import annotations

import logging
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import dist
from typing import ClassVar

from quadctl import Node, Params, start
from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, StateName
from quadctl.schemas.services import (
    GotoRequest,
    GotoResponse,
    ToggleCageRequest,
    ToggleCageResponse,
)
from quadctl.schemas.topics import GOTO, SETPOINT, STATE, TOGGLE_CAGE

logger = logging.getLogger("my_safety")


@dataclass(frozen=True)
class Verdict:
    """Result of a verification; no reason means accepted."""

    reason: str = ""

    @property
    def accepted(self) -> bool:
        return not self.reason


class Cage:
    """The virtual cage and the floor below it."""

    def __init__(self, size: CageSize) -> None:
        self.size = size
        self.is_on = True

    def contains(self, point: Position) -> bool:
        return (
            -self.size.x <= point.x <= self.size.x
            and -self.size.y <= point.y <= self.size.y
            and 0 <= point.z <= self.size.z
        )

    def verify(self, point: Position) -> Verdict:
        if point.z < 0:
            return Verdict(f"below the floor: z = {point.z:g} is less than 0")
        if self.is_on and not self.contains(point):
            return Verdict(f"outside the cage: {point.x:g}, {point.y:g}, {point.z:g}")
        return Verdict()


class State(ABC):
    """A state of the automaton; what it does not handle, it ignores."""

    name: ClassVar[StateName]

    @abstractmethod
    def on_goto(self, context: Automaton, request: GotoRequest) -> GotoResponse:
        """Answer a requested goal."""

    def on_cage_on(self, context: Automaton) -> None:  # noqa: B027
        """React to the cage, which has come on."""

    def on_pose(self, context: Automaton, pose: Pose) -> None:  # noqa: B027
        """React to a pose."""

    def refuse_busy(self, context: Automaton) -> GotoResponse:
        reason = f"busy: the vehicle is {self.name}"
        context.reason = reason
        context.publish()
        return GotoResponse(False, reason)


class Hovering(State):
    name = "HOVERING"

    def on_goto(self, context: Automaton, request: GotoRequest) -> GotoResponse:
        verifying = Verifying(refused_to=self)
        context.change_to(verifying)
        return verifying.verify(context, request)


class Verifying(State):
    name = "VERIFYING"

    def __init__(self, refused_to: State) -> None:
        self._refused_to = refused_to

    def on_goto(self, context: Automaton, request: GotoRequest) -> GotoResponse:
        return self.refuse_busy(context)

    def verify(self, context: Automaton, request: GotoRequest) -> GotoResponse:
        goal = Position(request.x, request.y, request.z)
        verdict = context.cage.verify(goal)
        context.reason = verdict.reason
        if verdict.accepted:
            context.goal, context.brake = goal, False
            context.change_to(Moving())
        else:
            logger.warning("refused %s: %s", goal, verdict.reason)
            context.change_to(self._refused_to)
        return GotoResponse(verdict.accepted, verdict.reason)


class Moving(State):
    name = "MOVING"

    def __init__(self, *, takes_off: bool = False) -> None:
        self._takes_off = takes_off

    def on_goto(self, context: Automaton, request: GotoRequest) -> GotoResponse:
        # A take-off is not replaced. A refused replacement leaves the flight as it is.
        if self._takes_off or not request.replace:
            return self.refuse_busy(context)
        verifying = Verifying(refused_to=self)
        context.change_to(verifying)
        return verifying.verify(context, request)

    def on_cage_on(self, context: Automaton) -> None:
        if not context.cage.contains(context.goal):
            context.stop("stopped: the cage is on, and the goal is outside")

    def on_pose(self, context: Automaton, pose: Pose) -> None:
        if context.distance(pose) < context.acceptance_range:
            context.change_to(Hovering())


class Automaton:
    """Context of the states: what they share, and the connection to the bus."""

    def __init__(self, node: Node, params: Params) -> None:
        size = params.safety.virtual_cage
        self.cage = Cage(CageSize(size.x, size.y, size.z))
        self.acceptance_range = params.safety.acceptance_range
        self._home = Position(0.0, 0.0, params.safety.takeoff)
        self._setpoints, self._states = node.publisher(SETPOINT), node.publisher(STATE)
        self._requests = 0
        self._pose: Pose | None = None
        self._take_off()
        node.serve(GOTO, self._on_goto)
        node.serve(TOGGLE_CAGE, self._on_toggle)
        logger.info("cage %s, acceptance range %g m", self.cage.size, self.acceptance_range)

    def _take_off(self) -> None:
        self._state: State = Moving(takes_off=True)
        self.goal, self.brake, self.reason = self._home, False, ""

    # For the states

    def change_to(self, state: State) -> None:
        logger.info("%s -> %s", self._state.name, state.name)
        self._state = state
        self.publish()

    def stop(self, reason: str) -> None:
        self.brake, self.reason = True, reason
        if self._pose is not None:
            self.goal = self._pose.position  # from now on it holds about this place
        self.change_to(Hovering())

    def distance(self, pose: Pose) -> float:
        here, goal = pose.position, self.goal
        return dist((here.x, here.y, here.z), (goal.x, goal.y, goal.z))

    def publish(self) -> None:
        if (pose := self._pose) is None:
            return
        self._states.put(
            SafetyState(
                boot=pose.boot,
                stamp=pose.stamp,
                request=self._requests,
                state=self._state.name,
                goal=self.goal,
                cage_on=self.cage.is_on,
                cage=self.cage.size,
                reason=self.reason,
            )
        )

    # For the bus

    def _on_goto(self, request: GotoRequest) -> GotoResponse:
        self._requests += 1
        return self._state.on_goto(self, request)

    def _on_toggle(self, request: ToggleCageRequest) -> ToggleCageResponse:
        self.cage.is_on = request.cage_on
        logger.info("cage %s", "on" if self.cage.is_on else "off")
        if self.cage.is_on:
            self._state.on_cage_on(self)
        self.publish()
        return ToggleCageResponse(True)

    def on_pose(self, pose: Pose) -> None:
        if self._pose is not None and pose.boot != self._pose.boot:
            logger.info("reset: take-off again")
            self._take_off()
        self._pose = pose
        self._state.on_pose(self, pose)
        self._setpoints.put(Setpoint(pose.boot, pose.seq, self.goal, self.brake))
        self.publish()


def run(node: Node, params: Params) -> None:
    logging.basicConfig(level=logging.INFO)
    automaton = Automaton(node, params)
    for pose in node.poses():
        automaton.on_pose(pose)
        time.sleep(0.01)  # do not burn the processor


start("safety", run)
