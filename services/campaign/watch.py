"""Which flights of a batch need their monitor in a period; of the others no rule does anything.

A pose moves the automaton only where one of the conditions of its rows for `Seen` may hold. Each
is told here of all vehicles at once, with slack to the side on which the monitor is asked; what the
monitor then decides is its own. The tests fly with and without, to the same states.
"""

import numpy as np
import numpy.typing as npt

from schemas.topics import SETPOINT
from services.campaign.lane import Lane
from services.campaign.oracle import Floats
from services.safety.conditions import AT_REST
from services.safety.model import State

_SLACK = 1e-9


class Watch:
    """What the monitors of a batch wait for."""

    def __init__(self, count: int) -> None:
        """All are wanted in the first period."""
        self._wanted = np.zeros(count)
        self._moving, self._settling = np.zeros(count, bool), np.zeros(count, bool)
        self._range, self._goal = np.zeros(count), np.zeros((3, count))
        self._low, self._high = np.full((3, count), -np.inf), np.full((3, count), np.inf)
        self._returning = np.zeros(count, bool)
        self._half, self._fastest = np.zeros(count), np.zeros(count)

    def note(self, number: int, lane: Lane) -> None:
        """What one monitor waits for from now on."""
        s, params = lane.monitor.situation, lane.params
        self._wanted[number] = lane.wanted
        self._moving[number], self._settling[number] = s.state is State.MOVING, s.settling
        self._range[number] = params.acceptance_range + _SLACK
        self._goal[:, number] = s.goal.x, s.goal.y, s.goal.z
        size, out = params.virtual_cage, 0.0 if s.cage_on else np.inf
        self._low[:, number] = _SLACK - size.x - out, _SLACK - size.y - out, _SLACK - out
        self._high[:, number] = size.x - _SLACK + out, size.y - _SLACK + out, size.z - _SLACK + out
        self._returning[number] = s.cage_on and s.beyond > 0.0
        self._half[number] = 0.5 / params.max_deceleration
        self._fastest[number] = params.max_speed / SETPOINT.hz

    def awake(self, period: int, motion: Floats, last: Floats) -> list[int]:
        """The monitors that are to see this pose, of (6, vehicles)."""
        place, velocity = motion[:3], motion[3:]
        arrives = _within(place - self._goal, self._range)
        rests = self._settling & _within(velocity, AT_REST + _SLACK)
        stop = place + self._half * velocity * np.abs(velocity)
        leaves = ((stop > self._high) | (stop < self._low)).any(axis=0)
        leaps = ~_within(place - last[:3], self._fastest)
        found = (
            (self._wanted <= period)
            | (self._moving & (arrives | leaves | self._returning))
            | rests
            | leaps
        )
        numbers: list[int] = np.flatnonzero(found).tolist()
        return numbers


def _within(vectors: Floats, length: Floats | float) -> npt.NDArray[np.bool_]:
    squares = vectors * vectors
    within: npt.NDArray[np.bool_] = squares[0] + squares[1] + squares[2] < length * length
    return within
