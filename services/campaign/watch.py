"""Which flights of a batch need their monitor in a period; of the others no rule does anything.

A pose moves the automaton only where one of the conditions of its rows for `Seen` may hold. Each
is told here of all vehicles at once, with slack to the side on which the monitor is asked; what the
monitor then decides is its own. The tests fly with and without, to the same states.
"""

from math import inf

import numpy as np
import numpy.typing as npt

from schemas.topics import SETPOINT
from services.campaign.lane import Lane
from services.campaign.oracle import Floats
from services.safety.cage import AT_REST
from services.safety.model import State

_SLACK = 1e-9
_NOTES = 17
"""What is noted of each monitor: when it is wanted, in periods, whether it is moving, standing,
settling and returning, its range, how far it takes to stop, how far it comes in a period, and these."""
_GOAL, _LOW, _HIGH = slice(8, 11), slice(11, 14), slice(14, 17)


class Watch:
    """What the monitors of a batch wait for."""

    def __init__(self, count: int) -> None:
        """All are wanted in the first period."""
        self._notes = np.zeros((_NOTES, count))
        self._notes[_LOW], self._notes[_HIGH] = -np.inf, np.inf

    def note(self, number: int, lane: Lane) -> None:
        """What one monitor waits for from now on."""
        s, params = lane.monitor.situation, lane.params
        goal, size, out = s.goal, params.virtual_cage, 0.0 if s.cage_on and s.beyond < inf else inf
        # One row of numbers: to write them one by one would take ten times as long.
        self._notes[:, number] = (
            lane.wanted, s.state is State.MOVING, lane.stands, s.settling,
            s.cage_on and 0.0 < s.beyond < inf,
            params.acceptance_range + _SLACK, 0.5 / params.max_deceleration,
            params.max_speed / SETPOINT.hz,
            goal.x, goal.y, goal.z,
            _SLACK - size.x - out, _SLACK - size.y - out, _SLACK - out,
            size.x - _SLACK + out, size.y - _SLACK + out, size.z - _SLACK + out,
        )  # fmt: skip

    def awake(self, period: int, motion: Floats, last: Floats) -> list[int]:
        """The monitors that are to see this pose, of (6, vehicles)."""
        place, velocity = motion[:3], motion[3:]
        wanted, moving, stands, settling, returning, reach, half, fastest = self._notes[:8]
        arrives = _within(place - self._notes[_GOAL], reach)
        rests = ((settling > 0.0) | (moving > stands)) & _within(velocity, AT_REST + _SLACK)
        starts = (stands > 0.0) & ~_within(velocity, AT_REST - _SLACK)
        stop = place + half * velocity * np.abs(velocity)
        leaves = ((stop > self._notes[_HIGH]) | (stop < self._notes[_LOW])).any(axis=0)
        leaps = ~_within(place - last[:3], fastest)
        found = (
            (wanted <= period)
            | ((moving > 0.0) & arrives)
            | leaves
            | (returning > 0.0)
            | rests
            | starts
            | leaps
        )
        numbers: list[int] = np.flatnonzero(found).tolist()
        return numbers


def _within(vectors: Floats, length: Floats | float) -> npt.NDArray[np.bool_]:
    squares = vectors * vectors
    within: npt.NDArray[np.bool_] = squares[0] + squares[1] + squares[2] < length * length
    return within
