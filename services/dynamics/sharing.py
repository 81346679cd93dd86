"""Sharing the limits of a vehicle's motion among its three axes.

SI units. Straight-line text, as in rigidbody.py; where a choice saves work, it is an `if` on its
own.
"""

from math import sqrt

from services.dynamics.axis import peak, stop

LEAST_SHARE = 1e-5
"""Least share of the limits of an axis, so that none is zero."""

TIGHT = 1e-9
"""A stop that passes the goal by less than this, relatively, does so by rounding."""

HALVINGS = 12
"""Steps of bisection for a share of the limits: to 1 in 4000."""

LONG = 2.0
"""Seconds of braking after which it is looked whether there is more to brake with."""

Limits = tuple[float, ...]
"""8 floats made by `limits_of`: speed, acceleration and jerk, the lag (s), its decay in a period,
the period in lags, the snap's lead in lags, and the periods after which an image is at rest."""

Axis = tuple[float, ...]
"""9 floats: position, velocity and acceleration of the path, the goal, the side of it that a stop
ends on (see axis.py), the share of the limits (0 to 1), and the jerk after one, two and three lags.
"""


def needed(axis: Axis, limits: Limits) -> float:
    """Return the least share of the limits that an axis can do with in its present motion.

    Where a stop can end short of the goal, one that does. Where none can, or where the axis
    moves away from the goal, the present one: with less, the stop would end beyond where it
    was bound to when the goal was moved, and that could be outside the cage. Never less than the
    share that its present acceleration takes: the axis goes on with that acceleration whatever
    its share, so a smaller one would give the difference away twice.
    """
    p, v, a, goal, _, share, _, _, _ = axis
    most_a = limits[1]
    most_j = limits[2]
    gap = goal - p
    part = stop(v, a, most_a, most_j) / (gap if gap != 0.0 else 1.0)
    if (gap != 0.0) & (part >= 0.0) & (part <= 1.0 + TIGHT):
        low = 0.0
        high = 1.0
        for _ in range(HALVINGS):
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
    """The share of the limits that an axis must have, and the way that it still has to go, m."""
    p, v, a, goal, heading, share, _, _, _ = axis
    need = share
    if heading != 0.0:
        need = needed(axis, limits)
    moves = (v != 0.0) | (a != 0.0)
    way = goal - p - stop(v, a, share * limits[1], share * limits[2])
    return need if moves else 0.0, 0.0 if heading == 0.0 else way


def within(
    x: Axis, y: Axis, z: Axis, nx: float, ny: float, nz: float
) -> tuple[float, float, float]:
    """Return the needs of the axes, met as far as the squares of the shares add up to 1.

    No axis gets less than it has, if it needs that much. Where the rest is too little for what is
    needed on top, an axis passes a goal that was moved nearer, but never the one before, which it
    could stop at with the share that it has.
    """
    hx = nx if nx < x[5] else x[5]
    hy = ny if ny < y[5] else y[5]
    hz = nz if nz < z[5] else z[5]
    had = hx * hx + hy * hy + hz * hz
    left = 1.0 - had if had < 1.0 else 0.0
    more = nx * nx + ny * ny + nz * nz - had
    k = left / more if more > left else 1.0
    return (
        sqrt(hx * hx + k * (nx * nx - hx * hx)),
        sqrt(hy * hy + k * (ny * ny - hy * hy)),
        sqrt(hz * hz + k * (nz * nz - hz * hz)),
    )


def urgent(axis: Axis, way: float, part: float) -> float:
    """Return the square of what a stop would give an axis on top, where it has to turn round.

    That is where its stop ends beyond its goal: it may be bound out of the cage, and is to get no
    farther than if it were told to stop. `way` is from its stop's end to the goal, m.
    """
    return part * axis[1] * axis[1] if axis[1] * way < 0.0 else 0.0


def grant(axis: Axis, need: float, cosine: float, left: float, limits: Limits) -> Axis:
    """An axis with its new share of the limits."""
    p, v, a, goal, heading, _, j1, j2, j3 = axis
    share = sqrt(need * need + left * cosine * cosine)
    share = LEAST_SHARE if share < LEAST_SHARE else share
    share = 1.0 if share > 1.0 else share
    short = stop(v, a, share * limits[1], share * limits[2]) <= goal - p
    side = 1.0 if short else -1.0
    return (p, v, a, goal, 0.0 if heading == 0.0 else side, share, j1, j2, j3)


def freed(axis: Axis, limits: Limits) -> Axis:
    """An axis that would brake for long is on its way again, and may get a larger share.

    One that got next to nothing, while others needed all, stops on its goal from wherever it is:
    at a walking pace, for minutes.
    """
    p, v, a, goal, heading, share, j1, j2, j3 = axis
    j = share * limits[2]
    side, top, hold = peak(v, a, share * limits[1], j)
    slow = (heading == 0.0) & ((side * a + 2.0 * top) / j + hold > LONG)
    return (p, v, a, goal, 1.0 if slow else heading, share, j1, j2, j3)


def kept(axis: Axis) -> float:
    """Return the share that an axis keeps in a stop: what it has, and none where it has stopped."""
    return axis[5] if (axis[1] != 0.0) | (axis[2] != 0.0) else 0.0


def lent(axis: Axis, need: float, left: float) -> Axis:
    """Return an axis with its need and a part of what is left, given as a square."""
    p, v, a, goal, heading, _, j1, j2, j3 = axis
    share = sqrt(need * need + left)
    return (p, v, a, goal, heading, LEAST_SHARE if share < LEAST_SHARE else share, j1, j2, j3)


def lend(x: Axis, y: Axis, z: Axis) -> tuple[Axis, Axis, Axis]:
    """Return the axes with the limits shared for a stop.

    Each that still moves keeps its share. The rest goes by the squares of the speeds: a stop with
    more ends sooner, and nearer.
    """
    nx = kept(x)
    ny = kept(y)
    nz = kept(z)
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

    An axis that is stopping keeps its share, one on its way gets what it needs if there is as much.
    So the vector of acceleration is within its limit whatever goals are replaced. An axis that has
    to turn round gets as much as in a stop. What is left then goes by the squares of the ways still
    to go, which from rest makes all three profiles alike but for scale: a straight line.
    """
    x = freed(x, limits)
    y = freed(y, limits)
    z = freed(z, limits)
    nx, wx = claim(x, limits)
    ny, wy = claim(y, limits)
    nz, wz = claim(z, limits)
    nx, ny, nz = within(x, y, z, nx, ny, nz)
    total = sqrt(wx * wx + wy * wy + wz * wz)
    total = total if total > 0.0 else 1.0
    left = 1.0 - (nx * nx + ny * ny + nz * nz)
    left = left if left > 0.0 else 0.0
    speeds = x[1] * x[1] + y[1] * y[1] + z[1] * z[1]
    part = left / speeds if speeds > 0.0 else 0.0
    ux = urgent(x, wx, part)
    uy = urgent(y, wy, part)
    uz = urgent(z, wz, part)
    nx = sqrt(nx * nx + ux)
    ny = sqrt(ny * ny + uy)
    nz = sqrt(nz * nz + uz)
    left = left - (ux + uy + uz)
    left = left if left > 0.0 else 0.0
    return (
        grant(x, nx, wx / total, left, limits),
        grant(y, ny, wy / total, left, limits),
        grant(z, nz, wz / total, left, limits),
    )
