"""One axis of the jerk-limited setpoint: how far a stop takes, and the jerk of the next step.

The axis is a triple integrator (position, velocity, acceleration) under a jerk that is constant
over each control period, integrated exactly. The rule needs no plan and no memory: of all
accelerations that the next period may end with, take the one from which the time-minimal stop
ends on the goal. Far from the goal that is the limit of jerk, acceleration or speed; near it,
the stop itself. A goal moved in flight, or limits that change, are then nothing special.

Straight-line text, as in rigidbody.py. SI units; all limits are positive.
"""

from math import sqrt

from services.dynamics.controller import PERIOD

LANDING = 5.0
"""The last three periods begin nearer than this many times jerk x period^3."""

NO_DISTANCE, NO_SPEED, NO_ACCELERATION = 1e-11, 1e-9, 1e-7
"""Rounding left by the last three periods, m, m/s, m/s^2: below it the axis is put at rest."""


def stop(v: float, a: float, most_a: float, j: float) -> tuple[float, float, float]:
    """Displacement (m) of the time-minimal stop, and its derivatives by v (s) and by a (s^2).

    From v, a to rest with |jerk| <= j: towards the peak deceleration b at full jerk, hold it
    where b is the limit, and back to 0. Holding is needed for the speed `held` that two ramps
    do not take away. Integrating the three pieces and collecting terms gives the polynomial.
    """
    # A negative stop is the mirror image of a positive one.
    s = 1.0 if v + a * abs(a) / (2.0 * j) >= 0.0 else -1.0
    v = s * v
    a = s * a
    half = 0.5 * a * a
    root = sqrt(j * v + half) if j * v + half > 0.0 else 0.0
    b = root if root < most_a else most_a
    held = v + (half - b * b) / j if root > most_a else 0.0
    slope = held / most_a + (a + 1.5 * b) / j
    return (
        s * ((b * b * (a + b) - a * half / 3.0) / (j * j) + held * (slope - 0.5 * held / most_a)),
        slope,
        ((b * b - half) / j + a * slope + held) / j,
    )


def advance(
    p: float, v: float, a: float, goal: float, most_v: float, most_a: float, j: float
) -> tuple[float, float, float, float]:
    """Position, velocity and acceleration one period on, and the jerk that leads there.

    From anywhere to rest on `goal` (m) within the limits of speed, acceleration and jerk; the
    last three periods end on it exactly. Beyond a limit at first, it comes back within it.
    """
    h = PERIOD
    gap = goal - p
    b = (
        landing(gap, v, a, most_v, most_a, j)
        if abs(gap) < LANDING * j * h * h * h
        else towards(gap, v, a, most_v, most_a, j)
    )
    p1 = p + h * v + h * h / 6.0 * (a + a + b)
    v1 = v + 0.5 * h * (a + b)
    off = abs(goal - p1) / NO_DISTANCE + abs(v1) / NO_SPEED + abs(b) / NO_ACCELERATION
    return (
        goal if off < 1.0 else p1,
        0.0 if off < 1.0 else v1,
        0.0 if off < 1.0 else b,
        (b - a) / h,
    )


def landing(
    gap: float, v: float, a: float, most_v: float, most_a: float, j: float
) -> float:
    """Acceleration to end the period with, by the deadbeat law where its jerks are permitted.

    Three periods of constant jerk take a triple integrator from any state to rest; these are
    the first two of the three jerks, and the third undoes the acceleration that is left.
    """
    h = PERIOD
    v2 = v / (h * h)
    a1 = a / h
    u1 = gap / (h * h * h) - 2.0 * v2 - 11.0 / 6.0 * a1
    u2 = -v2 - 2.5 * a1 - 2.0 * u1
    u3 = -a1 - u1 - u2
    # Half the acceleration limit on each jerk keeps the acceleration between them within it.
    most = j if j < 0.5 * most_a / h else 0.5 * most_a / h
    fits = (abs(u1) <= most) & (abs(u2) <= most) & (abs(u3) <= most)
    return a + u1 * h if fits else towards(gap, v, a, most_v, most_a, j)


def towards(
    gap: float, v: float, a: float, most_v: float, most_a: float, j: float
) -> float:
    """Acceleration (m/s^2) to end the next period with, for a goal `gap` m ahead.

    The displacement of the next period and of a stop after it grows with that acceleration, so
    its root in the permitted interval is what is wanted; two Newton steps from the upper end
    find it to 1e-7 m, and what remains is mended by the next period.
    """
    h = PERIOD
    change = j * h
    s = 1.0 if v + a * abs(a) / (2.0 * j) >= 0.0 else -1.0
    # With the acceleration brought to 0 at once, the speed must not pass its limit.
    over = s * (v + 0.5 * h * a) - most_v
    ramp = j * (sqrt(0.25 * h * h + 2.0 * abs(over) / j) - 0.5 * h)
    cap = -ramp if over > 0.0 else ramp
    cap = most_a if cap > most_a else cap
    high = cap if s > 0.0 else most_a
    low = -most_a if s > 0.0 else -cap
    high = a + change if high > a + change else high
    high = a - change if high < a - change else high
    low = a - change if low < a - change else low
    low = a + change if low > a + change else low
    gap = gap - h * v - h * h * a / 3.0
    v = v + 0.5 * h * a
    widest = abs(a) if abs(a) > most_a else most_a
    d, dv, da = stop(v + 0.5 * h * high, high, widest, j)
    miss = d + h * h / 6.0 * high - gap
    return high if miss <= 0.0 else nearer(high, miss, dv, da, gap, v, low, widest, j)


def nearer(
    b: float, miss: float, dv: float, da: float,
    gap: float, v: float, low: float, most_a: float, j: float,
) -> float:
    """Two more Newton steps down from acceleration b, kept above `low`; helper of `towards`."""
    h = PERIOD
    b = b - miss / (h * h / 6.0 + 0.5 * h * dv + da)
    b = low if b < low else b
    d, dv, da = stop(v + 0.5 * h * b, b, most_a, j)
    b = b - (d + h * h / 6.0 * b - gap) / (h * h / 6.0 + 0.5 * h * dv + da)
    return low if b < low else b
