"""The setpoint: a jerk-limited path to the goal, smoothed so that its snap is finite.

Each axis moves by axis.py. The three share the limits of speed, acceleration and jerk so that
their vector sums keep them, and so that a path from rest is a straight line. Three equal
first-order lags then round the steps of the jerk: a vehicle whose torque lags cannot follow
those, and would pass the goal by centimetres; with the lags the setpoint can be flown exactly.
A lagged path stays between the goal and where it came from, because a lag is a weighted mean.

World frame ENU, SI units.
"""

from math import exp, sqrt

from schemas.params import DynamicsParams
from services.dynamics import axis as path
from services.dynamics.controller import PERIOD, Setpoint, lead

LEAST_LAG = 0.03
"""Shortest lag, s: with 0.022 a step of 40 m/s^3 in descent takes all the thrust there is."""

LAGS_TO_SETTLE = 40.0
"""Lags after which a decay is below the rounding of what it decays to: e^-40 is 4e-18."""

LEAST_SHARE = 1e-5
"""Least share of the limits of an axis, so that none is zero."""

TIGHT = 1e-9
"""A stop that passes the goal by less than this, relatively, does so by rounding."""

REDIVIDE = 25
"""Control periods after which axes that were sent elsewhere in flight share the limits anew."""

HALVINGS = 12
"""Steps of bisection for a share of the limits: to 1 in 4000."""

Vector = tuple[float, float, float]


class Axis:
    """One axis: its path, its share of the limits (0 to 1), and the lagged image of the path."""

    __slots__ = ("a", "goal", "heading", "j1", "j2", "j3", "p", "share", "smooth", "v")

    def __init__(self, position: float) -> None:
        """At rest on `position`, m."""
        self.p = self.goal = position
        self.v = self.a = self.j1 = self.j2 = self.j3 = 0.0
        self.heading = 0.0
        self.share = 1.0
        self.smooth = (position, 0.0, 0.0, 0.0, 0.0)
        """Position, velocity, acceleration, jerk and led snap of the setpoint."""

    @property
    def at_rest(self) -> bool:
        """Whether the path, though perhaps not yet its image, stands on the goal."""
        return self.v == 0.0 and self.a == 0.0 and self.p == self.goal

    def advance(self, most: Vector, lag: float, decay: float, ratio: float, led: float) -> bool:
        """One period on, with the whole limits of speed, acceleration and jerk; True if it moved.

        The image is that of the path after three lags of `lag` seconds; `ratio` is the period in
        lags, `decay` exp(-ratio) and `led` how many lags the snap is ahead of the rest.
        """
        p, v, a = self.p, self.v, self.a
        moves = not (v == 0.0 and a == 0.0 and p == self.goal)
        jerk = 0.0
        if moves:
            n = self.share
            p, v, b, self.heading = path.advance(
                p, v, a, self.goal, self.heading, n * most[0], n * most[1], n * most[2]
            )
            jerk = (b - a) / PERIOD
            self.p, self.v, self.a = p, v, b
            a = b
        # The exact response of lags in series to a constant jerk; then, as each lag's output
        # lies behind its input by the lag times its own rate, the path's image from the top.
        c1 = self.j1 - jerk
        c2 = self.j2 - jerk
        c3 = self.j3 - jerk
        self.j1 = j1 = jerk + c1 * decay
        self.j2 = j2 = jerk + (c2 + ratio * c1) * decay
        self.j3 = j3 = jerk + (c3 + ratio * (c2 + 0.5 * ratio * c1)) * decay
        a1 = a - lag * j1
        a2 = a1 - lag * j2
        a3 = a2 - lag * j3
        v1 = v - lag * a1
        v2 = v1 - lag * a2
        v3 = v2 - lag * a3
        s3 = (j2 - j3) / lag
        s2 = (j1 - j2) / lag
        self.smooth = (p - lag * (v1 + v2 + v3), v3, a3, j3, s3 + led * (s2 - s3))
        return moves

    def settle(self) -> None:
        """Put the image at rest where the path is."""
        self.j1 = self.j2 = self.j3 = 0.0
        self.smooth = (self.p, 0.0, 0.0, 0.0, 0.0)

    def stop(self, most: Vector, share: float) -> float:
        """Displacement of a stop from now with this share of the limits, m."""
        return path.stop(self.v, self.a, share * most[1], share * most[2])

    def needed(self, most: Vector) -> float:
        """Least share of the limits that this axis can do with in its present motion.

        Where a stop can end short of the goal, one that does. Where none can, or where the axis
        moves away from the goal, the present one: with less, the stop would end beyond where it
        was bound to when the goal was moved, and that could be outside the cage. The sum of
        the squares may thereby pass 1 for a while.
        """
        gap = self.goal - self.p
        if gap == 0.0 or not 0.0 <= self.stop(most, 1.0) / gap <= 1.0 + TIGHT:
            return self.share
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            fits = 0.0 <= self.stop(most, middle) / gap <= 1.0
            low = low if fits else middle
            high = middle if fits else high
        return high


class Trajectory:
    """The setpoint generator, one control period at a time."""

    def __init__(self, params: DynamicsParams, position: Vector) -> None:
        """At rest on `position`, m."""
        self._axes = (Axis(position[0]), Axis(position[1]), Axis(position[2]))
        self._moving = 0
        self._crowded = False
        self._periods = 0
        self._most = (0.0, 0.0, 0.0)
        self.configure(params)
        self._still = self._settled
        self.setpoint: Setpoint = (*position, *(0.0,) * 12)
        """What to follow now, as `controller.control` takes it."""

    def configure(self, params: DynamicsParams) -> None:
        """Take new limits and a new motor lag; the path goes on from where it is."""
        limits = params.control
        most = (limits.max_speed, limits.max_acceleration, limits.max_jerk)
        self._lag = max(lead(params), LEAST_LAG)
        self._ratio = PERIOD / self._lag
        self._decay = exp(-self._ratio)
        self._led = lead(params) / self._lag
        self._settled = int(LAGS_TO_SETTLE / self._ratio)
        if most != self._most:
            self._most = most
            for axis in self._axes:
                axis.heading = 0.0 if axis.at_rest else 1.0
            self._divide()

    @property
    def goal(self) -> Vector:
        """Where the path leads, m."""
        x, y, z = self._axes
        return x.goal, y.goal, z.goal

    @property
    def at_rest(self) -> bool:
        """Whether the setpoint stands on the goal, for good."""
        return self._still >= self._settled

    def goto(self, x: float, y: float, z: float) -> None:
        """Come to rest at this point, m."""
        for axis, point in zip(self._axes, (x, y, z), strict=True):
            if axis.goal != point:
                axis.goal = point
                axis.heading = 1.0
        self._still = 0
        self._crowded = self._moving > 0
        self._divide()

    def brake(self) -> None:
        """Come to rest where each axis soonest does with its present share of the limits."""
        for axis in self._axes:
            axis.goal = axis.p + axis.stop(self._most, axis.share)
            axis.heading = 0.0
        self._still = 0

    def advance(self) -> None:
        """Move `setpoint` on by one control period."""
        if self._still >= self._settled:
            return
        most, lag, decay, ratio, led = self._most, self._lag, self._decay, self._ratio, self._led
        x, y, z = self._axes
        moving = (
            x.advance(most, lag, decay, ratio, led)
            + y.advance(most, lag, decay, ratio, led)
            + z.advance(most, lag, decay, ratio, led)
        )
        self._periods += 1
        if moving < self._moving or (self._crowded and self._periods % REDIVIDE == 0):
            self._divide()
        self._moving = moving
        self._still = 0 if moving else self._still + 1
        if self._still >= self._settled:
            for axis in self._axes:
                axis.settle()
        px, vx, ax, jx, sx = x.smooth
        py, vy, ay, jy, sy = y.smooth
        pz, vz, az, jz, sz = z.smooth
        self.setpoint = (px, py, pz, vx, vy, vz, ax, ay, az, jx, jy, jz, sx, sy, sz)

    def _divide(self) -> None:
        """Share the limits among the axes, so that the squares of the shares add up to 1.

        An axis that is stopping keeps its share, one on its way gets what it needs. What is left
        goes by the squares of the ways still to go, which from rest makes all three profiles
        alike but for scale: a straight line.
        """
        most = self._most
        needs, ways = [], []
        for axis in self._axes:
            stopping = axis.heading == 0.0
            needs.append(0.0 if axis.at_rest else axis.share if stopping else axis.needed(most))
            ways.append(0.0 if stopping else axis.goal - axis.p - axis.stop(most, axis.share))
        total = sqrt(sum(way * way for way in ways))
        left = max(0.0, 1.0 - sum(need * need for need in needs))
        for axis, need, way in zip(self._axes, needs, ways, strict=True):
            cosine = way / total if total > 0.0 else 0.0
            share = sqrt(need * need + left * cosine * cosine)
            axis.share = min(max(share, LEAST_SHARE), 1.0)
            if axis.heading != 0.0:
                axis.heading = 1.0 if axis.stop(most, axis.share) <= axis.goal - axis.p else -1.0
