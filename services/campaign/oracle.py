"""What must hold in every flight, told without a word of the automaton's: the score of a batch.

Counted is how far the true position goes beyond the cage in force. A vehicle that was inside when
the cage came on or got its bounds must not go beyond it. One that was put outside by that, or
could no longer stop inside, may go as far as its stopping point at that instant, and never out
again where it has come nearer since.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Point = tuple[float, float, float]


def inside(point: Point, size: Point) -> bool:
    """Whether a point is in the cage, walls included; what is no place is not."""
    (x, y, z), (cx, cy, cz) = point, size
    return -cx <= x <= cx and -cy <= y <= cy and 0.0 <= z <= cz


def farthest(corners: Sequence[Sequence[float]], size: Point) -> float:
    """How far beyond the cage (m) a vehicle can get that stays in the box around some points."""
    outs = [
        max(_out(value, *wall) for value in values)
        for values, wall in zip(zip(*corners, strict=True), _walls(size), strict=True)
    ]
    return sqrt(sum(out * out for out in outs))


def _walls(size: Point) -> tuple[tuple[float, float], ...]:
    cx, cy, cz = size
    return (-cx, cx), (-cy, cy), (0.0, cz)


def _out(value: float, low: float, high: float) -> float:
    return max(low - value, value - high, 0.0)


class Score:
    """The worst excursion of each vehicle of a batch, m."""

    def __init__(self, count: int) -> None:
        """No cage is in force yet."""
        self.worst = np.zeros(count)
        self.at = np.zeros(count)
        """When it was, s."""
        self.allowed = np.full(count, np.inf)
        """How far beyond the cage each may be, m."""
        self._low, self._high = np.full((3, count), -np.inf), np.full((3, count), np.inf)

    def free(self, number: int) -> None:
        """The cage of one vehicle is off."""
        self.allowed[number] = np.inf

    def confine(self, number: int, size: Point, allowed: float) -> None:
        """The cage of one vehicle is on from now, and lets it be so far beyond it, m."""
        self._low[:, number], self._high[:, number] = zip(*_walls(size), strict=True)
        self.allowed[number] = allowed

    def returning(self) -> Sequence[int]:
        """Which vehicles are allowed to be outside, and so may come nearer."""
        found: list[int] = np.flatnonzero((self.allowed > 0.0) & (self.allowed < np.inf)).tolist()
        return found

    def nearer(self, number: int, allowed: float) -> None:
        """One vehicle can stop nearer now than it could: farther out it has not to go again."""
        self.allowed[number] = min(self.allowed[number], allowed)

    def sample(self, positions: Floats, times: Sequence[float]) -> None:
        """Count where all were at some times (s): (times, 3, vehicles), m."""
        low, high = self._low - positions, positions - self._high
        outs = np.maximum(np.maximum(low, high), 0.0)
        squares = outs * outs
        beyond = np.sqrt(squares[:, 0] + squares[:, 1] + squares[:, 2])
        excursion = beyond - self.allowed
        worst = excursion.max(axis=0)
        for number in np.flatnonzero(worst > self.worst).tolist():
            self.worst[number] = worst[number]
            self.at[number] = times[int(excursion[:, number].argmax())]
