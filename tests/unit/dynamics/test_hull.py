"""Lemmas on the setpoint's path, checked for all values."""

from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Any

import pytest
import z3

from quadctl.services.dynamics import trajectory
from tests.support.symbolic import Number, opaque, paths, term, violation


@pytest.mark.thorough
@pytest.mark.parametrize("heading", [1.0, -1.0])
def test_an_axis_speeds_up_only_if_it_can_still_stop_at_its_goal(
    monkeypatch: pytest.MonkeyPatch, heading: float
):
    """Exact for doubles: what is proved is the very comparison that the path is taken by."""
    for name in ("stop", "sqrt"):
        monkeypatch.setattr(trajectory, name, lambda *of, name=name: opaque(name, *of))
    for name in ("ramp", "decelerate"):
        monkeypatch.setattr(trajectory, name, lambda *_: (Number(), Number(), Number()))
    monkeypatch.setattr(trajectory, "switch", lambda *_: Number())
    values: Any = [Number() for _ in range(8)]
    p, v, a, goal, most_v, most_a, least_a, j = values
    kept = 0
    for solver, (p1, v1, a1, side) in paths(
        [], lambda: trajectory.advance_axis(p, v, a, goal, heading, most_v, most_a, least_a, j)
    ):
        assert side in {heading, 0.0}
        if side == heading:
            kept += 1
            past = heading * (p1 + trajectory.stop(v1, a1, most_a, j) - goal)
            assert violation(solver, z3.Not(term(past) > term(0.0))) is None, values
    assert kept > 0


@dataclass(frozen=True)
class Rated:
    """Real number with its rate of change."""

    value: Any
    rate: Any = 0

    def __add__(self, other: Any) -> "Rated":
        other = rated(other)
        return Rated(self.value + other.value, self.rate + other.rate)

    def __sub__(self, other: Any) -> "Rated":
        return self + -1 * rated(other)

    def __mul__(self, other: Any) -> "Rated":
        other = rated(other)
        return Rated(self.value * other.value, self.rate * other.value + self.value * other.rate)

    def __truediv__(self, other: Any) -> "Rated":
        other = rated(other)
        fall = self.value * other.rate / other.value
        return Rated(self.value / other.value, (self.rate - fall) / other.value)

    __radd__ = __add__
    __rmul__ = __mul__


def rated(value: Any) -> Rated:
    return value if isinstance(value, Rated) else Rated(Fraction(value))


@pytest.mark.thorough
def test_the_setpoint_is_the_path_after_three_equal_lags():
    """Then it is a weighted mean of the path so far, and stays in any interval that has the path.

    With y the setpoint, T the lag and rates by t / T, y + 3 y' + 3 y'' + y''' is the path. Exact for real
    numbers, at any moment of a period in which the jerk is constant: both sides are linear in the path
    and the jerks, and polynomials in the rest, of less than the number of the values tried.
    """
    for place, decay, lags, lag in product(range(7), range(1, 4), range(1, 8), range(1, 8)):
        p, v, a, j1, j2, j3, jerk = (Rated(Fraction(place == n)) for n in range(7))
        now: Any = trajectory.ramp(p, v, a, jerk, Rated(lag * lags, lag))
        weights = Rated(decay, -decay), Rated(lags, 1)
        jerks: Any = trajectory.lagged(j1, j2, j3, jerk, *weights)
        axis: Any = (*now, 0.0, 0.0, 1.0, *jerks)
        limits: Any = (0.0, 0.0, 0.0, Rated(lag), 0.0, 0.0, 0.0, 0.0)
        y, y1, y2, y3, *_ = map(rated, trajectory.filtered(axis, limits))
        assert (y.rate, y1.rate, y2.rate) == (lag * y1.value, lag * y2.value, lag * y3.value)
        path = y.value + 3 * y.rate + 3 * lag * y1.rate + lag * lag * y2.rate
        assert path == rated(now[0]).value
