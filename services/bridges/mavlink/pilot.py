"""Pilot: flies one errand of a ground station after the other - a goal, a landing or a mission.

Each goal goes to safety, like every other one. A new errand ends the one before.
"""

import threading
import time
from collections.abc import Callable, Sequence

from quadctl.schemas.messages import PAUSED, Pose, Position, SafetyState
from quadctl.schemas.services import GotoRequest
from quadctl.services.bridges.mavlink.plan import MissionStep
from quadctl.services.runtime.errors import QuadctlError, Refused

_SLOW, _GROUND = 0.05, 0.05
"""Speed (m/s) of a vehicle at rest, and height (m) of one on the ground."""
_PATIENCE = 5.0
"""Seconds within which the state shows an accepted goal or a stop."""


class Errand:
    """Steps to fly, in a mode that ground stations show; `current` is the number of the present one.

    `lands` is true from the begin of a landing; `landed` at its end, until the next step.
    """

    def __init__(self, mode: int, steps: Sequence[MissionStep], current: int = 0) -> None:
        self.mode, self.steps, self.current = mode, steps, current
        self.lands = self.landed = False


class Pilot:
    """Flies errands, each on a thread of its own. `request` asks safety for a goal, `hold` stops.

    Both block. Calls `on_reached` after each step with its number, and `on_end` after an errand that
    nobody has ended, with its problem if it has one.
    """

    def __init__(
        self,
        request: Callable[[GotoRequest], None],
        hold: Callable[[], None],
        on_reached: Callable[[Errand, int], None],
        on_end: Callable[[Errand, QuadctlError | None], None],
    ) -> None:
        self._request, self._hold = request, hold
        self._on_reached, self._on_end = on_reached, on_end
        # Held while safety is asked: what an ended errand asks for must not come after a stop.
        self._turn = threading.Lock()
        self._change = threading.Condition()
        self.errand: Errand | None = None
        self._pose: Pose | None = None
        self._state: SafetyState | None = None
        self._before = self._own = -1
        """Numbers of the request before our last one, and of that one, in safety's count."""

    def see(self, message: Pose | SafetyState) -> None:
        """Take the newest pose or state."""
        with self._change:
            if isinstance(message, Pose):
                self._pose = message
            else:
                self._state = message
            self._change.notify_all()

    def begin(self, errand: Errand) -> None:
        """Request the first goal of an errand, then fly it all.

        Raises Refused if safety refuses it; the errand before goes on then.
        """
        with self._turn:
            goal = self._ask(errand.steps[errand.current])
            self._become(errand)
        threading.Thread(target=self._fly, args=(errand, goal), daemon=True).start()

    def stop(self) -> None:
        """End the errand, if any, and stop the vehicle."""
        with self._turn:
            self._become(None)
            self._hold()

    def drop(self) -> None:
        """End the errand, if any: the vehicle is at its start again. It does not block."""
        self._become(None)

    def _become(self, errand: Errand | None) -> None:
        with self._change:
            self.errand = errand
            self._change.notify_all()

    def _ask(self, step: MissionStep) -> Position | None:
        """Request the goal of a step from safety, and return it; raise Refused with its reason."""
        place = self._pose.position if self._pose else None
        if not step.flies or place is None:
            return None
        goal = Position(
            place.x if step.x is None else step.x,
            place.y if step.y is None else step.y,
            place.z if step.z is None else step.z,
        )
        self._before = self._state.request if self._state else -1
        self._request(GotoRequest(goal.x, goal.y, goal.z, replace=True))
        return goal

    def _fly(self, errand: Errand, goal: Position | None) -> None:
        problem: QuadctlError | None = None
        try:
            self._fly_steps(errand, goal)
        except _Ended:
            return
        except QuadctlError as error:
            problem = error
        with self._turn:
            if self.errand is not errand:
                return
            self._become(None)
        self._on_end(errand, problem)

    def _fly_steps(self, errand: Errand, goal: Position | None) -> None:
        last = len(errand.steps) - 1
        while True:
            step = errand.steps[errand.current]
            self._arrive(errand, goal)
            self._wait(errand, goal, lambda: False, step.wait)
            if step.lands:
                goal = self._land(errand, goal)
            self._on_reached(errand, errand.current)
            if errand.current == last:
                return
            errand.current += 1
            errand.lands = errand.landed = False
            # A step without a goal keeps the one before.
            goal = self._next(errand, errand.steps[errand.current]) or goal

    def _next(self, errand: Errand, step: MissionStep) -> Position | None:
        with self._turn:
            if self.errand is not errand:
                raise _Ended
            return self._ask(step)

    def _land(self, errand: Errand, goal: Position | None) -> Position | None:
        errand.lands = True
        self._wait(errand, goal, self._rests)
        ground = self._next(errand, MissionStep(z=0.0))
        self._arrive(errand, ground)
        self._wait(errand, ground, self._is_down)
        errand.landed = True
        return ground

    def _is_down(self) -> bool:
        return self._pose is not None and self._pose.position.z < _GROUND and self._rests()

    def _rests(self) -> bool:
        v = self._pose.velocity if self._pose else None
        return v is not None and abs(v.x) + abs(v.y) + abs(v.z) < _SLOW

    def _arrive(self, errand: Errand, goal: Position | None) -> None:
        """Wait until the vehicle hovers at a goal, or without one is not on its way elsewhere."""
        self._wait(errand, goal, lambda: self._shows(goal), _PATIENCE, watch=False)
        if goal is not None:
            self._own = self._state.request if self._state else -1
            self._wait(errand, goal, self._hovers)

    def _shows(self, goal: Position | None) -> bool:
        """Return whether safety's state shows our request for a goal, or for none, no motion."""
        state = self._state
        if state is None or goal is None:
            return state is not None and state.state != "MOVING"
        return state.request > self._before and state.goal == goal

    def _hovers(self) -> bool:
        return self._state is not None and self._state.state == "HOVERING" and not self._pauses()

    def _pauses(self) -> bool:
        return self._state is not None and self._state.reason.startswith(PAUSED)

    def _is_lost(self, goal: Position | None) -> bool:
        """Return whether the vehicle has another goal than this one, or has been stopped."""
        state = self._state
        if state is None or self._pauses():
            # A paused flight goes on by itself, or ends with another reason.
            return False
        if goal is None:
            return state.state == "MOVING"
        # The reason may also be that of another program's refused request, which has its own number.
        stopped = state.state == "HOVERING" and state.reason and state.request == self._own
        return state.goal != goal or bool(stopped)

    def _wait(
        self,
        errand: Errand,
        goal: Position | None,
        condition: Callable[[], bool],
        limit: float | None = None,
        *,
        watch: bool = True,
    ) -> None:
        """Wait for a condition, at most `limit` s; meanwhile the vehicle has to keep its goal.

        Raises Refused if it does not, and _Ended if the errand has been ended.
        """
        ends = None if limit is None else time.monotonic() + limit
        with self._change:
            while True:
                if self.errand is not errand:
                    raise _Ended
                if watch and self._is_lost(goal):
                    assert self._state is not None  # noqa: S101 - else nothing is lost
                    raise Refused(
                        self._state.reason or "another program sent the vehicle elsewhere"
                    )
                left = None if ends is None else ends - time.monotonic()
                if condition() or (left is not None and left <= 0):
                    return
                self._change.wait(left)


class _Ended(Exception):
    """End of an errand by another one, or by a stop."""
