"""Pilot: flies one errand of a ground station after the other - a goal, a landing or a mission.

Each goal goes to safety, like every other one. A new errand ends the one before.
"""

import threading
import time
from collections.abc import Callable, Sequence

from quadctl.schemas.messages import WAITS, Pose, Position, SafetyState
from quadctl.schemas.services import GotoRequest, GotoResponse
from quadctl.services.mavlink.plan import MissionStep
from quadctl.services.runtime.errors import QuadctlError, Refused

_SLOW, _GROUND = 0.05, 0.05
"""Speed (m/s) of a vehicle at rest, and height (m) of one on the ground."""
_PATIENCE = 5.0
"""Seconds within which the state shows an accepted goal, and a vehicle comes to rest."""


class Errand:
    """Steps to fly, in a mode that ground stations show; `current` is the number of the present one."""

    def __init__(self, mode: int, steps: Sequence[MissionStep], current: int = 0) -> None:
        self.mode, self.steps, self.current = mode, steps, current
        self.lands = False


class Pilot:
    """Flies errands on a thread of its own. `request` asks safety for a goal, and blocks.

    Calls `on_reached` after each step with its number, and `on_end` after an errand, with its problem.
    """

    def __init__(
        self,
        request: Callable[[GotoRequest], GotoResponse],
        on_reached: Callable[[Errand, int], None],
        on_end: Callable[[Errand, QuadctlError | None], None],
    ) -> None:
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
        """Request the first goal of an errand, then fly it all; raise Refused if safety refuses it."""
        with self._change:
            before, self.errand = self.errand, errand
            self._change.notify_all()
        try:
            goal = self._ask(errand.steps[errand.current])
        except QuadctlError:
            with self._change:
                if self.errand is errand:
                    # The flight before goes on.
                    self.errand = before
            raise
        threading.Thread(target=self._fly, args=(errand, goal), daemon=True).start()

    def end(self) -> None:
        """End the errand, if any; the vehicle still flies to its goal, until it is stopped."""
        with self._change:
            self.errand = None
            self._change.notify_all()

    def _ask(self, step: MissionStep) -> Position | None:
        """Request the goal of a step from safety; raise Refused with its reason. Return the goal."""
        place = self._pose.position if self._pose else None
        if not step.flies or place is None:
            return None
        goal = Position(
            place.x if step.x is None else step.x,
            place.y if step.y is None else step.y,
            place.z if step.z is None else step.z,
        )
        reply = self._request(GotoRequest(goal.x, goal.y, goal.z, replace=True))
        if not reply.accepted:
            raise Refused(reply.reason)
        return goal

    def _fly(self, errand: Errand, goal: Position | None) -> None:
        problem: QuadctlError | None = None
        try:
            while True:
                step = errand.steps[errand.current]
                self._arrive(errand, goal)
                self._wait(errand, lambda: False, step.wait)
                if step.lands:
                    self._land(errand)
                if not self._flies(errand):
                    return
                self._on_reached(errand, errand.current)
                if errand.current + 1 == len(errand.steps):
                    break
                errand.current += 1
                goal = self._ask(errand.steps[errand.current])
        except QuadctlError as error:
            problem = error
        with self._change:
            if not self._flies(errand):
                return
            self.errand = None
        self._on_end(errand, problem)

    def _flies(self, errand: Errand) -> bool:
        return self.errand is errand

    def _land(self, errand: Errand) -> None:
        errand.lands = True
        self._wait(errand, self._rests, _PATIENCE)
        if self._flies(errand):
            self._arrive(errand, self._ask(MissionStep(z=0.0)))
            self._wait(errand, self._is_down, _PATIENCE)

    def _is_down(self) -> bool:
        return self._pose is not None and self._pose.position.z < _GROUND and self._rests()

    def _rests(self) -> bool:
        v = self._pose.velocity if self._pose else None
        return v is not None and abs(v.x) + abs(v.y) + abs(v.z) < _SLOW

    def _arrive(self, errand: Errand, goal: Position | None) -> None:
        """Wait until the vehicle hovers at a goal; raise Refused if it has been stopped."""
        if goal is None:
            return

        def taken() -> bool:
            s = self._state
            return s is not None and s.goal == goal and s.state != "VERIFYING"

        self._wait(errand, taken, _PATIENCE)
        self._wait(errand, lambda: not taken() or self._hovers(), None)
        state = self._state
        if self._flies(errand) and state and (state.goal != goal or _stopped(state)):
            raise Refused(state.reason or "another program sent the vehicle elsewhere")

    def _hovers(self) -> bool:
        return self._state is not None and self._state.state == "HOVERING"

    def _wait(self, errand: Errand, condition: Callable[[], bool], limit: float | None) -> None:
        """Wait for a condition, at most `limit` s, or for the end of the errand."""
        ends = None if limit is None else time.monotonic() + limit
        with self._change:
            while self._flies(errand) and not condition():
                left = None if ends is None else ends - time.monotonic()
                if left is not None and left <= 0:
                    return
                self._change.wait(left)


def _stopped(state: SafetyState) -> bool:
    return bool(state.reason) and not state.reason.startswith(WAITS)
