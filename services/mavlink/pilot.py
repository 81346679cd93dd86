"""Pilot: flies one errand of a ground station after the other - a goal, a landing or a mission.

Each goal goes to safety, like every other one. A new errand ends the one before.
"""

import threading
import time
from collections.abc import Callable, Sequence

from quadctl.schemas.messages import WAITS, Pose, Position, SafetyState
from quadctl.schemas.services import GotoRequest, GotoResponse
from quadctl.services.mavlink.plan import Step
from quadctl.services.runtime.errors import QuadctlError, Refused

_AT_REST, _GROUND = 0.05, 0.05
"""Speed (m/s) and height (m) below which a vehicle has landed."""
_VERDICT = 5.0
"""Seconds within which the state shows an accepted goal."""


class Errand:
    """Steps to fly, in a mode that ground stations see."""

    def __init__(self, mode: int, steps: Sequence[Step], *, first: int = 0) -> None:
        self.mode, self.steps, self.current = mode, steps, first
        self.lands = False
        self.is_over = False


class Pilot:
    """Flies errands on a thread of its own; `request` asks safety for a goal, and blocks."""

    def __init__(
        self,
        request: Callable[[GotoRequest], GotoResponse],
        on_reached: Callable[[int], None],
        on_end: Callable[[Errand, QuadctlError | None], None],
    ) -> None:
        """Take who is told of each step reached, and of the end of an errand, with its problem."""
        self._request, self._on_reached, self._on_end = request, on_reached, on_end
        self._change = threading.Condition()
        self.errand: Errand | None = None
        self._pose: Pose | None = None
        self._state: SafetyState | None = None

    def see(self, message: Pose | SafetyState) -> None:
        """Take the newest pose or state."""
        with self._change:
            if isinstance(message, Pose):
                self._pose = message
            else:
                self._state = message
            self._change.notify_all()

    def begin(self, errand: Errand) -> None:
        """Request the first goal of an errand; raise Refused if safety refuses it, else fly it all."""
        with self._change:
            before, self.errand = self.errand, errand
            self._change.notify_all()
        try:
            self._begin(errand.steps[errand.current])
        except QuadctlError:
            with self._change:
                if self.errand is errand:
                    # The flight before goes on.
                    self.errand = before
            raise
        threading.Thread(target=self._fly, args=(errand,), daemon=True).start()

    def end(self) -> None:
        """End the errand, if any; whoever calls it stops the vehicle, or sends it elsewhere."""
        with self._change:
            self.errand = None
            self._change.notify_all()

    def _begin(self, step: Step) -> None:
        if step.goal is None:
            return
        x, y, z = step.goal.x, step.goal.y, step.goal.z
        reply = self._request(GotoRequest(x, y, z, replace=True))
        if not reply.accepted:
            raise Refused(reply.reason)

    def _fly(self, errand: Errand) -> None:
        problem: QuadctlError | None = None
        try:
            while self._flies(errand):
                step = errand.steps[errand.current]
                self._finish(errand, step)
                if not self._flies(errand):
                    return
                self._on_reached(errand.current)
                if errand.current + 1 == len(errand.steps):
                    break
                errand.current += 1
                self._begin(errand.steps[errand.current])
        except QuadctlError as error:
            problem = error
        with self._change:
            if self.errand is not errand:
                return
            errand.is_over = True
            self.errand = None
        self._on_end(errand, problem)

    def _flies(self, errand: Errand) -> bool:
        return self.errand is errand

    def _finish(self, errand: Errand, step: Step) -> None:
        if step.goal is not None:
            self._arrive(errand, step.goal)
        if step.wait:
            self._wait(errand, lambda: False, step.wait)
        if step.lands:
            errand.lands = True
            self._land(errand)

    def _land(self, errand: Errand) -> None:
        with self._change:
            place = self._pose.position if self._pose else None
        if place is None or not self._flies(errand):
            return
        ground = Position(place.x, place.y, 0.0)
        self._begin(Step(ground))
        self._arrive(errand, ground)
        self._wait(errand, self._is_down, _VERDICT)

    def _is_down(self) -> bool:
        pose = self._pose
        if pose is None or pose.position.z > _GROUND:
            return False
        v = pose.velocity
        return abs(v.x) + abs(v.y) + abs(v.z) < _AT_REST

    def _arrive(self, errand: Errand, goal: Position) -> None:
        """Wait until the vehicle hovers at a goal; raise Refused if safety has stopped it."""

        def taken() -> bool:
            s = self._state
            return s is not None and s.goal == goal and s.state != "VERIFYING"

        self._wait(errand, taken, _VERDICT)
        self._wait(errand, lambda: not taken() or self._hovers(), None)
        state = self._state
        if self._flies(errand) and state and (state.goal != goal or _stopped(state)):
            raise Refused(state.reason or "another program sent the vehicle elsewhere")

    def _hovers(self) -> bool:
        return self._state is not None and self._state.state == "HOVERING"

    def _wait(self, errand: Errand, condition: Callable[[], bool], limit: float | None) -> None:
        ends = None if limit is None else time.monotonic() + limit
        with self._change:
            while self._flies(errand) and not condition():
                left = None if ends is None else ends - time.monotonic()
                if left is not None and left <= 0:
                    return
                self._change.wait(left)


def _stopped(state: SafetyState) -> bool:
    return bool(state.reason) and not state.reason.startswith(WAITS)
