"""Usual period of the setpoint without branches, for SIMD over several vehicles.

`trajectory.advance` has loops for rare cases: finding the moment from which an axis brakes, and
sharing the limits again. Such a period is only detected here; `trajectory.advance` computes it,
with bit-identical results. Straight-line code, as in rigidbody.py; SI units.
"""

from quadctl.services.dynamics.controller import PERIOD
from quadctl.services.dynamics.trajectory import (
    REDIVIDE,
    Axis,
    Limits,
    Plan,
    accelerate,
    decelerate,
    lag_behind,
)

NOTHING = 0.0
"""The setpoint is at rest: no new plan."""
PLAIN = 1.0
"""The new plan is `trajectory.advance`'s."""
RARE = 2.0
"""The new plan is not: call `trajectory.advance`."""


def axis_on(axis: Axis, limits: Limits) -> tuple[Axis, float, float]:
    """Return an axis one period later, 1 if it moved, and 1 if it should have begun to brake."""
    p, v, a, goal, heading, share, _, _, _ = axis
    most_v, most_a, most_j, _, _, _, _, least_a = limits
    most_v = share * most_v
    most_a = share * most_a
    least_a = share * least_a
    most_j = share * most_j
    moves = (v != 0.0) | (a != 0.0) | (p != goal)
    brakes = heading == 0.0
    p1, v1, a1 = decelerate(p, v, a, goal, most_a, most_j, PERIOD)
    p2, v2, a2, _, past = accelerate(p, v, a, goal, heading, most_v, most_a, least_a, most_j)
    p2 = p1 if brakes else p2
    v2 = v1 if brakes else v2
    a2 = a1 if brakes else a2
    p2 = p2 if moves else p
    v2 = v2 if moves else v
    a2 = a2 if moves else a
    j1, j2, j3 = lag_behind(axis, p2, v2, a2, limits)
    turns = moves & (heading != 0.0) & (past > 0.0)
    return (
        (p2, v2, a2, goal, heading, share, j1, j2, j3),
        1.0 if moves else 0.0,
        1.0 if turns else 0.0,
    )


def glide(plan: Plan, limits: Limits) -> tuple[Plan, float]:
    """Return the plan one control period later, and its kind: NOTHING, PLAIN or RARE."""
    x, y, z, moving, crowded, periods, still = plan
    x, mx, tx = axis_on(x, limits)
    y, my, ty = axis_on(y, limits)
    z, mz, tz = axis_on(z, limits)
    now = mx + my + mz
    periods = 0.0 if periods + 1.0 == REDIVIDE else periods + 1.0
    rests = 0.0 if now > 0.0 else still + 1.0
    divides = (now < moving) | ((crowded > 0.0) & (periods == 0.0))
    rare = (tx + ty + tz > 0.0) | divides | (rests >= limits[6])
    kind = RARE if rare else PLAIN
    return (x, y, z, now, crowded, periods, rests), kind if still < limits[6] else NOTHING
