"""Lemmas on the setpoint's path, checked by an SMT solver for all values."""

from dataclasses import dataclass
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
    return value if isinstance(value, Rated) else Rated(value)


def test_the_setpoint_is_the_path_after_three_equal_lags():
    """Then it is a weighted mean of the path so far, and stays in any interval that has the path.

    With y the setpoint and T the lag, y + 3 T y' + 3 T^2 y'' + T^3 y''' is the path. Exact for real
    numbers, at any moment of a period in which the jerk is constant.
    """
    reals = z3.Reals("p v a j1 j2 j3 jerk lag t decay")
    p, v, a, j1, j2, j3, jerk, lag, t, decay = reals
    now: Any = trajectory.ramp(*map(rated, (p, v, a, jerk)), Rated(t, 1))
    weights = Rated(decay, -decay / lag), Rated(t / lag, 1 / lag)
    jerks: Any = trajectory.lagged(*map(rated, (j1, j2, j3, jerk)), *weights)
    axis: Any = (*now, 0.0, 0.0, 1.0, *jerks)
    limits: Any = (0.0, 0.0, 0.0, Rated(lag), 0.0, 0.0, 0.0, 0.0)
    y, y1, y2, y3, *_ = map(rated, trajectory.filtered(axis, limits))
    solver = z3.Solver()
    solver.add(lag > 0, decay > 0)
    path = rated(now[0]).value
    for equal in (
        y.rate == y1.value,
        y1.rate == y2.value,
        y2.rate == y3.value,
        y.value + 3 * lag * y1.value + 3 * lag**2 * y2.value + lag**3 * y3.value == path,
    ):
        assert solver.check(z3.Not(equal)) == z3.unsat
