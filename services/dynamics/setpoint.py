"""The setpoint: a jerk-limited path to the goal, smoothed so that its snap is finite.

Each axis moves by axis.py. The three share the limits of speed, acceleration and jerk so that
their vector sums keep them, and so that a path from rest is a straight line. Three equal
first-order lags then round the steps of the jerk: a vehicle whose torque lags cannot follow
those, and would pass the goal by centimetres; with the lags the setpoint can be flown exactly.
A lagged path stays between the goal and where it came from, because a lag is a weighted mean.

World frame ENU, SI units. Straight-line text, as in rigidbody.py; where a choice saves work, it
is an `if` on its own.
"""

from math import exp

from schemas.params import DynamicsParams
from services.dynamics.axis import advance as advance_path
from services.dynamics.axis import stop
from services.dynamics.controller import PERIOD, Setpoint, lead
from services.dynamics.sharing import Axis, Limits, divide, lend

LEAST_LAG = 0.05
"""Shortest lag, s: with 0.03 short climbs aslant, and goals replaced to and fro in a descent, take
torques for which there is not the thrust: a campaign found one flight in 200 up to 6 cm off."""

LAGS_TO_SETTLE = 40.0
"""Lags after which a decay is below the rounding of what it decays to: e^-40 is 4e-18."""

REDIVIDE = 25.0
"""Control periods after which axes that were sent elsewhere in flight share the limits anew."""

BRAKES = 2.0
"""In a plan that comes to rest wherever it soonest can."""

Plan = tuple[Axis, Axis, Axis, float, float, float, float]
"""The axes x, y and z; how many of them moved; 1 after a goal that was moved in flight, or BRAKES;
periods since the limits were shared, up to REDIVIDE; periods at rest."""


def limits_of(params: DynamicsParams) -> Limits:
    """What the setpoint needs of the parameters, in the order of use."""
    limits = params.control
    lag = max(lead(params), LEAST_LAG)
    ratio = PERIOD / lag
    return (
        limits.max_speed,
        limits.max_acceleration,
        limits.max_jerk,
        lag,
        exp(-ratio),
        ratio,
        lead(params) / lag,
        float(int(LAGS_TO_SETTLE / ratio)),
    )


def standing_at(position: float) -> Axis:
    """An axis at rest, m."""
    return (position, 0.0, 0.0, position, 0.0, 1.0, 0.0, 0.0, 0.0)


def resting(x: float, y: float, z: float, limits: Limits) -> Plan:
    """A plan at rest, m."""
    return (standing_at(x), standing_at(y), standing_at(z), 0.0, 0.0, 0.0, limits[7])


def at_rest(plan: Plan, limits: Limits) -> bool:
    """Whether the setpoint stands on the goal, for good."""
    return plan[6] >= limits[7]


def image(axis: Axis, limits: Limits) -> tuple[float, float, float, float, float]:
    """Position, velocity, acceleration, jerk and led snap of the path after three lags.

    Each lag's output lies behind its input by the lag times its own rate.
    """
    p, v, a, _, _, _, j1, j2, j3 = axis
    _, _, _, lag, _, _, led, _ = limits
    a1 = a - lag * j1
    a2 = a1 - lag * j2
    a3 = a2 - lag * j3
    v1 = v - lag * a1
    v2 = v1 - lag * a2
    v3 = v2 - lag * a3
    s3 = (j2 - j3) / lag
    s2 = (j1 - j2) / lag
    return p - lag * (v1 + v2 + v3), v3, a3, j3, s3 + led * (s2 - s3)


def setpoint_of(plan: Plan, limits: Limits) -> Setpoint:
    """What to follow now, as `controller.control` takes it."""
    px, vx, ax, jx, sx = image(plan[0], limits)
    py, vy, ay, jy, sy = image(plan[1], limits)
    pz, vz, az, jz, sz = image(plan[2], limits)
    return (px, py, pz, vx, vy, vz, ax, ay, az, jx, jy, jz, sx, sy, sz)


def follow(axis: Axis, limits: Limits) -> tuple[Axis, float]:
    """An axis one period on, and 1 if it moved, else 0."""
    p, v, a, goal, heading, share, j1, j2, j3 = axis
    most_v, most_a, most_j, _, decay, ratio, _, _ = limits
    moves = (v != 0.0) | (a != 0.0) | (p != goal)
    jerk = 0.0
    if moves:
        old = a
        p, v, a, heading = advance_path(
            p, v, a, goal, heading, share * most_v, share * most_a, share * most_j
        )
        jerk = (a - old) / PERIOD
    j1, j2, j3 = lagged(j1, j2, j3, jerk, decay, ratio)
    return (p, v, a, goal, heading, share, j1, j2, j3), 1.0 if moves else 0.0


def lagged(
    j1: float, j2: float, j3: float, jerk: float, decay: float, ratio: float
) -> tuple[float, float, float]:
    """The jerk after one, two and three lags, m/s^3: the exact response to a constant one."""
    c1 = j1 - jerk
    c2 = j2 - jerk
    c3 = j3 - jerk
    return (
        jerk + c1 * decay,
        jerk + (c2 + ratio * c1) * decay,
        jerk + (c3 + ratio * (c2 + 0.5 * ratio * c1)) * decay,
    )


def settle(axis: Axis) -> Axis:
    """The image put at rest where the path is."""
    p, v, a, goal, heading, share, _, _, _ = axis
    return (p, v, a, goal, heading, share, 0.0, 0.0, 0.0)


def advance(plan: Plan, limits: Limits) -> Plan:
    """The plan one control period on."""
    x, y, z, moving, crowded, periods, still = plan
    if still < limits[7]:
        x, mx = follow(x, limits)
        y, my = follow(y, limits)
        z, mz = follow(z, limits)
        now = mx + my + mz
        periods = 0.0 if periods + 1.0 == REDIVIDE else periods + 1.0
        if (now < moving) | ((crowded > 0.0) & (periods == 0.0)):
            if crowded == BRAKES:
                x, y, z = halt(x, y, z, limits)
            else:
                x, y, z = divide(x, y, z, limits)
        moving = now
        still = 0.0 if now > 0.0 else still + 1.0
        if still >= limits[7]:
            x = settle(x)
            y = settle(y)
            z = settle(z)
    return (x, y, z, moving, crowded, periods, still)


def aim(axis: Axis, point: float) -> Axis:
    """An axis sent to a point, m."""
    p, v, a, goal, heading, share, j1, j2, j3 = axis
    return (p, v, a, point, heading if goal == point else 1.0, share, j1, j2, j3)


def goto(plan: Plan, gx: float, gy: float, gz: float, limits: Limits) -> Plan:
    """Come to rest at this point, m."""
    x, y, z, moving, _, periods, _ = plan
    x, y, z = divide(aim(x, gx), aim(y, gy), aim(z, gz), limits)
    return (x, y, z, moving, 1.0 if moving > 0.0 else 0.0, periods, 0.0)


def end(axis: Axis, limits: Limits) -> Axis:
    """An axis that stops where it soonest does with its present share of the limits."""
    p, v, a, _, _, share, j1, j2, j3 = axis
    goal = p + stop(v, a, share * limits[1], share * limits[2])
    return (p, v, a, goal, 0.0, share, j1, j2, j3)


def stopping_place(plan: Plan, limits: Limits) -> tuple[float, float]:
    """Where x and y soonest come to rest, m."""
    x = end(plan[0], limits)
    y = end(plan[1], limits)
    return x[3], y[3]


def halt(x: Axis, y: Axis, z: Axis, limits: Limits) -> tuple[Axis, Axis, Axis]:
    """Return axes that stop where they soonest do, with the limits shared anew."""
    x, y, z = lend(x, y, z)
    return end(x, limits), end(y, limits), end(z, limits)


def brake(plan: Plan, limits: Limits) -> Plan:
    """Come to rest as soon as can be; axes that get more of the limits later stop nearer."""
    x, y, z, moving, _, periods, _ = plan
    x, y, z = halt(x, y, z, limits)
    return (x, y, z, moving, BRAKES, periods, 0.0)
