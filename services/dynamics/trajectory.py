"""Trajectory generator: from goals to a jerk-limited setpoint, smooth enough to be flown exactly.

Each axis is a triple integrator (position, velocity, acceleration) with limits of speed,
acceleration and jerk. In each period it takes the highest acceleration that the limits permit, as
long as the time-minimal stop still ends short of the goal. From then on it follows that stop; its
three pieces are integrated in closed form. There is no plan to discard: when the goal is moved in
flight, or the share changes, only the side of the goal on which the stop ends is computed again.

The three axes share the limits so that their vector sums keep them, and so that a path from rest is
a straight line. Three equal first-order lags then round the steps of the jerk: a vehicle with
torque lags cannot follow such steps, and would pass the goal by centimetres. The lagged path stays
between the goal and its start, because a lag is a weighted mean.

World frame ENU, SI units; all limits are positive. Straight-line code, as in rigidbody.py.

Over 500 lines: axes, shares and lags are one computation, and each can only be checked with all.
"""

from math import exp, sqrt

from quadctl.schemas.params import DynamicsParams
from quadctl.services.airspace.airworthiness import flown, setpoint_lag
from quadctl.services.dynamics.controller import PERIOD, Setpoint

SWITCH_HALVINGS = 40
"""Bisection steps for the moment to brake: to 4e-15 s."""

Motion = tuple[float, float, float]
"""Position (m), velocity (m/s) and acceleration (m/s^2)."""


def ramp(p: float, v: float, a: float, jerk: float, t: float) -> Motion:
    """Return the motion after `t` seconds of constant jerk, m/s^3."""
    half = 0.5 * jerk * t
    return p + t * (v + t * (0.5 * a + half / 3.0)), v + t * (a + half), a + jerk * t


def peak(v: float, a: float, most_a: float, j: float) -> tuple[float, float, float]:
    """Return side, peak deceleration (m/s^2) and time at the peak (s) of the time-minimal stop.

    The stop goes to the peak at full jerk and back to 0 at full jerk. If the limit caps the peak,
    the stop holds it until the speed that the two ramps do not remove is gone. The side is the sign
    of the speed once the acceleration is removed; a stop on side -1 mirrors one on side 1.
    """
    side = 1.0 if v + a * abs(a) / (2.0 * j) >= 0.0 else -1.0
    square = side * j * v + 0.5 * a * a
    # A deceleration beyond the limit, by rounding, is held, not raised.
    most = -side * a if -side * a > most_a else most_a
    held = square - most * most
    top = most if held > 0.0 else sqrt(square if square > 0.0 else 0.0)
    return side, top, (held if held > 0.0 else 0.0) / (j * most)


def stop(v: float, a: float, most_a: float, j: float) -> float:
    """Return the displacement of the time-minimal stop, m: its three pieces integrated."""
    side, b, hold = peak(v, a, most_a, j)
    a = side * a
    return side * (
        (b * b * (a + b) - a * a * a / 6.0) / (j * j) + hold * b * (0.5 * hold + (a + 1.5 * b) / j)
    )


def decelerate(
    p: float, v: float, a: float, goal: float, most_a: float, j: float, t: float
) -> Motion:
    """Return the motion after `t` seconds of the time-minimal stop, which ends on `goal`, m."""
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


def advance_axis(
    p: float,
    v: float,
    a: float,
    goal: float,
    heading: float,
    most_v: float,
    most_a: float,
    least_a: float,
    j: float,
) -> tuple[float, float, float, float]:
    """Return the motion one period later, and the new heading.

    `heading` is the side of the stop's end that the goal is on, +1 or -1, or 0 while following the
    stop that ends on the goal. Kept limits stay kept; a speed above its limit returns to it.
    """
    if heading == 0.0:
        p, v, a = decelerate(p, v, a, goal, most_a, j, PERIOD)
    else:
        p1, v1, a1, jerk, past = accelerate(p, v, a, goal, heading, most_v, most_a, least_a, j)
        if past > 0.0:
            t = switch(p, v, a, jerk, goal, heading, most_a, j)
            p1, v1, a1 = ramp(p, v, a, jerk, t)
            p1, v1, a1 = decelerate(p1, v1, a1, goal, most_a, j, PERIOD - t)
            heading = 0.0
        p, v, a = p1, v1, a1
    return p, v, a, heading


def accelerate(
    p: float,
    v: float,
    a: float,
    goal: float,
    heading: float,
    most_v: float,
    most_a: float,
    least_a: float,
    j: float,
) -> tuple[float, float, float, float, float]:
    """Return the motion one period later at the highest acceleration permitted towards the heading.

    It falls from `most_a` at rest to `least_a` at `most_v`: drag takes the rest of the force.
    Also the jerk for it, m/s^3, and how far a stop from there would pass the goal, m.
    """
    h = PERIOD
    v0 = heading * v
    a0 = heading * a
    # The speed must not pass its limit while the acceleration is then removed at full jerk, in
    # whole periods (which may take half a period more): v + a^2 / 2j + a h / 2.
    over = v0 + 0.5 * h * a0 - most_v
    cap = j * (sqrt(h * h + 2.0 * abs(over) / j) - h)
    high = -cap if over > 0.0 else cap
    high = high if high > -most_a else -most_a
    # An axis that lost a part of its share may be many times too fast: there it stays `least_a`.
    most = most_a + (least_a - most_a) * (v0 if v0 < most_v else most_v) / most_v
    # While moving away, a pull back beyond the limit is held, as the stop holds it.
    most = (a0 if a0 > most_a else most_a) if v0 < 0.0 else most
    high = high if high < most else most
    high = high if high < a0 + j * h else a0 + j * h
    high = high if high > a0 - j * h else a0 - j * h
    jerk = heading * (high - a0) / h
    p1, v1, a1 = ramp(p, v, a, jerk, h)
    return p1, v1, a1, jerk, heading * (p1 + stop(v1, a1, most_a, j) - goal)


def switch(
    p: float, v: float, a: float, jerk: float, goal: float, heading: float, most_a: float, j: float
) -> float:
    """Return the moment within a period (s) from which the stop ends on the goal, by bisection."""
    early = 0.0
    late = PERIOD
    for _ in range(SWITCH_HALVINGS):
        t = 0.5 * (early + late)
        p1, v1, a1 = ramp(p, v, a, jerk, t)
        passes = heading * (p1 + stop(v1, a1, most_a, j) - goal) > 0.0
        early = early if passes else t
        late = t if passes else late
    return early


LEAST_SHARE = 1e-5
"""Smallest share of the limits of an axis, so that none is zero."""
TIGHT = 1e-9
"""Relative overshoot of the goal below which a stop overshoots only by rounding."""
SHARE_HALVINGS = 12
"""Bisection steps for a share of the limits: to 1 in 4000."""
LONG = 2.0
"""Seconds of braking after which an axis may claim a larger share."""

Limits = tuple[float, ...]
"""8 floats made by `limits_of`: speed, acceleration and jerk, the lag (s), its decay in a period, the
period in lags, the periods until the lagged path is at rest, and the acceleration to speed up with
at the highest speed."""

Axis = tuple[float, ...]
"""9 floats: position, velocity and acceleration of the path, the goal, the heading (see
`advance_axis`), the share of the limits (0 to 1), and the jerk after one, two and three lags."""


def needed(axis: Axis, limits: Limits) -> float:
    """Return the least share of the limits that the present motion of an axis needs.

    With that share its stop ends short of the goal; if no stop can, with its present share. Never
    less than the share of the present acceleration: the axis continues with it whatever its share,
    so a smaller one would give the difference away twice.
    """
    p, v, a, goal, _, share, _, _, _ = axis
    most_a = limits[1]
    most_j = limits[2]
    gap = goal - p
    part = stop(v, a, share * most_a, share * most_j) / (gap if gap != 0.0 else 1.0)
    if (gap != 0.0) & (part >= 0.0) & (part <= 1.0 + TIGHT):
        low = 0.0
        high = share
        for _ in range(SHARE_HALVINGS):
            middle = 0.5 * (low + high)
            part = stop(v, a, middle * most_a, middle * most_j) / gap
            # With too little jerk to end its braking in time it would first pass its stop's end.
            left = gap * (v + a * abs(a) / (2.0 * middle * most_j))
            fits = (part >= 0.0) & (part <= 1.0) & (left >= 0.0)
            low = low if fits else middle
            high = middle if fits else high
        share = high
    floor = abs(a) / most_a
    return floor if share < floor else share


def claim(axis: Axis, limits: Limits) -> tuple[float, float]:
    """Return the share of the limits that an axis must have, and its remaining way, m."""
    p, v, a, goal, heading, share, _, _, _ = axis
    need = share
    if heading != 0.0:
        need = needed(axis, limits)
    moves = (v != 0.0) | (a != 0.0)
    way = goal - p - stop(v, a, share * limits[1], share * limits[2])
    return need if moves else 0.0, 0.0 if heading == 0.0 else way


def assign_share(axis: Axis, need: float, cosine: float, left: float, limits: Limits) -> Axis:
    """Return an axis with its new share of the limits."""
    p, v, a, goal, heading, _, j1, j2, j3 = axis
    share = sqrt(need * need + left * cosine * cosine)
    share = LEAST_SHARE if share < LEAST_SHARE else share
    share = 1.0 if share > 1.0 else share
    short = stop(v, a, share * limits[1], share * limits[2]) <= goal - p
    side = 1.0 if short else -1.0
    return (p, v, a, goal, 0.0 if heading == 0.0 else side, share, j1, j2, j3)


def release_slow_axis(axis: Axis, limits: Limits) -> Axis:
    """Return the axis, no longer braking if its stop takes long, so that its share can grow.

    An axis left with almost no share would otherwise brake at walking pace, for minutes.
    """
    p, v, a, goal, heading, share, j1, j2, j3 = axis
    j = share * limits[2]
    side, top, hold = peak(v, a, share * limits[1], j)
    slow = (heading == 0.0) & ((side * a + 2.0 * top) / j + hold > LONG)
    return (p, v, a, goal, 1.0 if slow else heading, share, j1, j2, j3)


def kept(axis: Axis, limits: Limits) -> float:
    """Return the share that an axis keeps in a stop: its own, or that of its acceleration; at rest 0."""
    _, v, a, _, _, share, _, _, _ = axis
    used = abs(a) / limits[1]
    used = share if used < share else used
    return used if (v != 0.0) | (a != 0.0) else 0.0


def lent(axis: Axis, need: float, left: float) -> Axis:
    """Return an axis with its need and a part of the rest, given as a square."""
    p, v, a, goal, heading, _, j1, j2, j3 = axis
    share = sqrt(need * need + left)
    return (p, v, a, goal, heading, LEAST_SHARE if share < LEAST_SHARE else share, j1, j2, j3)


def share_leftover(x: Axis, y: Axis, z: Axis, limits: Limits) -> tuple[Axis, Axis, Axis]:
    """Return the axes with the limits shared for a stop.

    Each axis that still moves keeps its share. The rest is divided by the squares of the speeds: a
    stop with a larger share ends sooner, and nearer.
    """
    nx = kept(x, limits)
    ny = kept(y, limits)
    nz = kept(z, limits)
    left = 1.0 - (nx * nx + ny * ny + nz * nz)
    left = left if left > 0.0 else 0.0
    total = x[1] * x[1] + y[1] * y[1] + z[1] * z[1]
    part = left / total if total > 0.0 else 0.0
    return (
        lent(x, nx, part * x[1] * x[1]),
        lent(y, ny, part * y[1] * y[1]),
        lent(z, nz, part * z[1] * z[1]),
    )


def divide(x: Axis, y: Axis, z: Axis, limits: Limits) -> tuple[Axis, Axis, Axis]:
    """Share the limits among the axes, so that the squares of the shares add up to 1.

    An axis that is stopping keeps its share; an axis on its way gets the share that it needs, which
    is no more than it has. So the vector of acceleration keeps its limit whatever goals are
    replaced. The rest is divided by the squares of the remaining ways: from rest, the profiles then
    differ only in scale, and the path is straight.
    """
    x = release_slow_axis(x, limits)
    y = release_slow_axis(y, limits)
    z = release_slow_axis(z, limits)
    nx, wx = claim(x, limits)
    ny, wy = claim(y, limits)
    nz, wz = claim(z, limits)
    total = sqrt(wx * wx + wy * wy + wz * wz)
    total = total if total > 0.0 else 1.0
    left = 1.0 - (nx * nx + ny * ny + nz * nz)
    left = left if left > 0.0 else 0.0
    return (
        assign_share(x, nx, wx / total, left, limits),
        assign_share(y, ny, wy / total, left, limits),
        assign_share(z, nz, wz / total, left, limits),
    )


LAGS_TO_SETTLE = 40.0
"""Lags after which a decay is below the rounding of its start value: e^-40 is 4e-18."""
REDIVIDE = 25.0
"""Control periods after which axes with goals moved in flight share the limits again."""
BRAKES = 2.0
"""Mark of a plan that comes to rest as soon as it can, wherever that is."""

Plan = tuple[Axis, Axis, Axis, float, float, float, float]
"""The axes x, y and z; the number of them that moved; 1 after a goal was moved in flight, or
BRAKES; periods since the limits were shared, up to REDIVIDE; periods at rest."""


def limits_of(params: DynamicsParams) -> Limits:
    """Return the parameters that the setpoint uses, in the order of use: what the body can fly."""
    limits = flown(params.vehicle, params.control, params.wind)
    lag = setpoint_lag(params.vehicle, params.control)
    ratio = PERIOD / lag
    return (
        limits.max_speed,
        limits.max_acceleration,
        limits.max_jerk,
        lag,
        exp(-ratio),
        ratio,
        float(int(LAGS_TO_SETTLE / ratio)),
        limits.acceleration_at_speed,
    )


def standing_at(position: float) -> Axis:
    """Return an axis at rest at a position, m."""
    return (position, 0.0, 0.0, position, 0.0, 1.0, 0.0, 0.0, 0.0)


def resting(x: float, y: float, z: float, limits: Limits) -> Plan:
    """Return a plan at rest at a point, m."""
    return (standing_at(x), standing_at(y), standing_at(z), 0.0, 0.0, 0.0, limits[6])


def at_rest(plan: Plan, limits: Limits) -> bool:
    """Return whether the setpoint rests on the goal, for good."""
    return plan[6] >= limits[6]


def filtered(axis: Axis, limits: Limits) -> tuple[float, float, float, float, float, float]:
    """Return position, velocity, acceleration, jerk, snap and crackle of the path after three lags.

    The output of each lag is behind its input by the lag times its own rate.
    """
    p, v, a, _, _, _, j1, j2, j3 = axis
    lag = limits[3]
    a1 = a - lag * j1
    a2 = a1 - lag * j2
    a3 = a2 - lag * j3
    v1 = v - lag * a1
    v2 = v1 - lag * a2
    v3 = v2 - lag * a3
    s3 = (j2 - j3) / lag
    s2 = (j1 - j2) / lag
    return p - lag * (v1 + v2 + v3), v3, a3, j3, s3, (s2 - s3) / lag


def setpoint_of(plan: Plan, limits: Limits) -> Setpoint:
    """Return the present setpoint, in the order that `controller.control` takes."""
    px, vx, ax, jx, sx, cx = filtered(plan[0], limits)
    py, vy, ay, jy, sy, cy = filtered(plan[1], limits)
    pz, vz, az, jz, sz, cz = filtered(plan[2], limits)
    return (px, py, pz, vx, vy, vz, ax, ay, az, jx, jy, jz, sx, sy, sz, cx, cy, cz)


def follow(axis: Axis, limits: Limits) -> tuple[Axis, float]:
    """Return an axis one period later, and 1 if it moved, else 0."""
    p, v, a, goal, heading, share, _, _, _ = axis
    most_v, most_a, most_j, _, _, _, _, least_a = limits
    moves = (v != 0.0) | (a != 0.0) | (p != goal)
    if moves:
        p, v, a, heading = advance_axis(
            p,
            v,
            a,
            goal,
            heading,
            share * most_v,
            share * most_a,
            share * least_a,
            share * most_j,
        )
    j1, j2, j3 = lag_behind(axis, p, v, a, limits)
    return (p, v, a, goal, heading, share, j1, j2, j3), 1.0 if moves else 0.0


def lag_behind(
    axis: Axis, p: float, v: float, a: float, limits: Limits
) -> tuple[float, float, float]:
    """Return the lagged jerks of an axis one period later, when its path has this motion.

    The jerk may change within the period. Its mean leads to the same acceleration, but to another
    speed, by up to 2e-4 m/s. Uncorrected, the lagged path would step by 0.02 mm, past its goal.
    """
    p0, v0, a0, _, _, _, j1, j2, j3 = axis
    _, _, _, lag, decay, ratio, _, _ = limits
    jerk = (a - a0) / PERIOD
    j1, j2, j3 = lagged(j1, j2, j3, jerk, decay, ratio)
    p_mean, v_mean, _ = ramp(p0, v0, a0, jerk, PERIOD)
    dv = (v - v_mean) / (lag * lag)
    dp = (p - p_mean) / (lag * lag * lag)
    return j1 - dv + dp, j2 + dv - 2.0 * dp, j3 + dp


def lagged(
    j1: float, j2: float, j3: float, jerk: float, decay: float, ratio: float
) -> tuple[float, float, float]:
    """Return the jerk after one, two and three lags, m/s^3: the exact response to a constant."""
    c1 = j1 - jerk
    c2 = j2 - jerk
    c3 = j3 - jerk
    return (
        jerk + c1 * decay,
        jerk + (c2 + ratio * c1) * decay,
        jerk + (c3 + ratio * (c2 + 0.5 * ratio * c1)) * decay,
    )


def settle(axis: Axis) -> Axis:
    """Return the axis with its lagged path put at rest on the path."""
    p, v, a, goal, heading, share, _, _, _ = axis
    return (p, v, a, goal, heading, share, 0.0, 0.0, 0.0)


def advance(plan: Plan, limits: Limits) -> Plan:
    """Return the plan one control period later."""
    x, y, z, moving, crowded, periods, still = plan
    if still < limits[6]:
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
        if still >= limits[6]:
            x = settle(x)
            y = settle(y)
            z = settle(z)
    return (x, y, z, moving, crowded, periods, still)


def aim(axis: Axis, point: float) -> Axis:
    """Return an axis with a point, m, as its goal."""
    p, v, a, goal, heading, share, j1, j2, j3 = axis
    return (p, v, a, point, heading if goal == point else 1.0, share, j1, j2, j3)


def goto(plan: Plan, gx: float, gy: float, gz: float, limits: Limits) -> Plan:
    """Return a plan that comes to rest at this point, m, which it should not pass: see `passes`."""
    x, y, z, moving, _, periods, _ = plan
    x, y, z = divide(aim(x, gx), aim(y, gy), aim(z, gz), limits)
    return (x, y, z, moving, 1.0 if moving > 0.0 else 0.0, periods, 0.0)


def end(axis: Axis, limits: Limits) -> Axis:
    """Return an axis that stops as soon as it can with its present share of the limits."""
    p, v, a, _, _, share, j1, j2, j3 = axis
    goal = p + stop(v, a, share * limits[1], share * limits[2])
    return (p, v, a, goal, 0.0, share, j1, j2, j3)


PAST = 0.001
"""Distance (m) past its goal at which a stop may end, and in which an axis has turned."""


def ends_past(axis: Axis, goal: float, limits: Limits) -> bool:
    """Return whether the stop of an axis leads it past a goal, m, or farther away from it."""
    p, v, a, _, _, share, _, _, _ = axis
    way = stop(v, a, share * limits[1], share * limits[2])
    past = p + way - goal
    return (way * past > 0.0) & (abs(way) > PAST) & (abs(past) > PAST)


def passes(plan: Plan, gx: float, gy: float, gz: float, limits: Limits) -> bool:
    """Return whether a flight to this point, m, would go past it, or first away from it."""
    return (
        ends_past(plan[0], gx, limits)
        | ends_past(plan[1], gy, limits)
        | ends_past(plan[2], gz, limits)
    )


def stopping_place(plan: Plan, limits: Limits) -> tuple[float, float, float]:
    """Return the place where the axes stop as soon as each can, m."""
    x = end(plan[0], limits)
    y = end(plan[1], limits)
    z = end(plan[2], limits)
    return x[3], y[3], z[3]


def halt(x: Axis, y: Axis, z: Axis, limits: Limits) -> tuple[Axis, Axis, Axis]:
    """Return axes that stop as soon as they can, with the limits shared again."""
    x, y, z = share_leftover(x, y, z, limits)
    return end(x, limits), end(y, limits), end(z, limits)


def brake(plan: Plan, limits: Limits) -> Plan:
    """Return a plan that stops as soon as it can; axes that gain share later stop nearer."""
    x, y, z, moving, _, periods, _ = plan
    x, y, z = halt(x, y, z, limits)
    return (x, y, z, moving, BRAKES, periods, 0.0)
