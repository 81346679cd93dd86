"""One axis of the jerk-limited path: accelerate towards the goal, then stop on it exactly.

The axis is a triple integrator (position, velocity, acceleration) with limits of speed,
acceleration and jerk. Each period it takes the highest acceleration the limits permit, for as
long as the time-minimal stop would still end short of the goal; from then on it follows that
stop, whose three pieces are integrated in closed form. There is no plan to throw away: a goal
moved in flight, or a new share, only asks anew on which side of the goal the stop would end.

Straight-line text, as in rigidbody.py; where a choice saves work, it is an `if` on its own. SI
units; all limits are positive.
"""

from math import sqrt

from services.dynamics.controller import PERIOD

HALVINGS = 40
"""Steps of bisection for the moment to brake: to 4e-15 s."""

Motion = tuple[float, float, float]
"""Position (m), velocity (m/s) and acceleration (m/s^2)."""


def ramp(p: float, v: float, a: float, jerk: float, t: float) -> Motion:
    """The motion after `t` seconds of constant jerk, m/s^3."""
    half = 0.5 * jerk * t
    return p + t * (v + t * (0.5 * a + half / 3.0)), v + t * (a + half), a + jerk * t


def peak(v: float, a: float, most_a: float, j: float) -> tuple[float, float, float]:
    """Side, peak deceleration (m/s^2) and time at the peak (s) of the time-minimal stop.

    It goes to the peak at full jerk, holds it where that is the limit, for the speed that two
    ramps do not take away, and goes back to 0 at full jerk. The side is that of the speed once
    the acceleration is taken away; a stop on side -1 is the mirror image of one on side 1.
    """
    side = 1.0 if v + a * abs(a) / (2.0 * j) >= 0.0 else -1.0
    square = side * j * v + 0.5 * a * a
    # A deceleration beyond the limit, by rounding, is held, not raised.
    most = -side * a if -side * a > most_a else most_a
    held = square - most * most
    top = most if held > 0.0 else sqrt(square if square > 0.0 else 0.0)
    return side, top, (held if held > 0.0 else 0.0) / (j * most)


def stop(v: float, a: float, most_a: float, j: float) -> float:
    """Displacement of the time-minimal stop, m: its three pieces integrated, terms collected."""
    side, b, hold = peak(v, a, most_a, j)
    a = side * a
    return side * (
        (b * b * (a + b) - a * a * a / 6.0) / (j * j) + hold * b * (0.5 * hold + (a + 1.5 * b) / j)
    )


def brake(p: float, v: float, a: float, goal: float, most_a: float, j: float, t: float) -> Motion:
    """The motion after `t` seconds of the time-minimal stop, which ends on `goal`, m."""
    side, b, t2 = peak(v, a, most_a, j)
    t1 = (side * a + b) / j
    t3 = b / j
    rests = t1 + t2 + t3 <= t
    t1 = t1 if t1 < t else t
    t2 = t2 if t2 < t - t1 else t - t1
    t3 = t3 if t3 < t - t1 - t2 else t - t1 - t2
    p, v, a = ramp(p, v, a, -side * j, t1)
    p, v, a = ramp(p, v, a, 0.0, t2)
    p, v, a = ramp(p, v, a, side * j, t3)
    return goal if rests else p, 0.0 if rests else v, 0.0 if rests else a


def advance(
    p: float,
    v: float,
    a: float,
    goal: float,
    heading: float,
    most_v: float,
    most_a: float,
    j: float,
) -> tuple[float, float, float, float]:
    """The motion one period on, and the heading from then.

    `heading` is the side of the stop's end that the goal is on, +1 or -1, or 0 while following
    the stop that ends on the goal. Limits that are kept stay kept; speed beyond its limit comes
    back within it.
    """
    if heading == 0.0:
        p, v, a = brake(p, v, a, goal, most_a, j, PERIOD)
    else:
        p1, v1, a1, jerk, past = press(p, v, a, goal, heading, most_v, most_a, j)
        if past > 0.0:
            t = switch(p, v, a, jerk, goal, heading, most_a, j)
            p1, v1, a1 = ramp(p, v, a, jerk, t)
            p1, v1, a1 = brake(p1, v1, a1, goal, most_a, j, PERIOD - t)
            heading = 0.0
        p, v, a = p1, v1, a1
    return p, v, a, heading


def press(
    p: float,
    v: float,
    a: float,
    goal: float,
    heading: float,
    most_v: float,
    most_a: float,
    j: float,
) -> tuple[float, float, float, float, float]:
    """The motion one period on under the highest acceleration permitted towards the heading.

    Then the jerk that this takes, m/s^3, and how far past the goal a stop from there would end, m.
    """
    h = PERIOD
    v0 = heading * v
    a0 = heading * a
    # With the acceleration then taken away at full jerk, though in whole periods (which may
    # take half a period more), the speed must not pass its limit: v + a^2 / 2j + a h / 2.
    over = v0 + 0.5 * h * a0 - most_v
    cap = j * (sqrt(h * h + 2.0 * abs(over) / j) - h)
    high = -cap if over > 0.0 else cap
    high = high if high > -most_a else -most_a
    # While moving away, a pull back beyond the limit is held, as the stop holds it.
    most = a0 if (v0 < 0.0) & (a0 > most_a) else most_a
    high = high if high < most else most
    high = high if high < a0 + j * h else a0 + j * h
    high = high if high > a0 - j * h else a0 - j * h
    jerk = heading * (high - a0) / h
    p1, v1, a1 = ramp(p, v, a, jerk, h)
    return p1, v1, a1, jerk, heading * (p1 + stop(v1, a1, most_a, j) - goal)


def switch(
    p: float,
    v: float,
    a: float,
    jerk: float,
    goal: float,
    heading: float,
    most_a: float,
    j: float,
) -> float:
    """The moment within a period (s) from which the stop ends on the goal, by bisection."""
    early = 0.0
    late = PERIOD
    for _ in range(HALVINGS):
        t = 0.5 * (early + late)
        p1, v1, a1 = ramp(p, v, a, jerk, t)
        passes = heading * (p1 + stop(v1, a1, most_a, j) - goal) > 0.0
        early = early if passes else t
        late = t if passes else late
    return early
