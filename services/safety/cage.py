"""Virtual cage, and the stopping distance of a vehicle in it.

A vehicle passes every point up to its stopping point, so that is what has to stay inside, as in the
approach speeds of other autopilots: at each distance from a wall there is a speed from which it still
stops before the wall.
"""

from math import dist, sqrt

from msgspec.structs import astuple, replace

from quadctl.schemas.messages import CageSize, Pose, Position
from quadctl.services.safety.model import Situation, World

Interval = tuple[float, float]


def bounds(cage: CageSize) -> dict[str, Interval]:
    """The interval of each axis, m."""
    return {"x": (-cage.x, cage.x), "y": (-cage.y, cage.y), "z": (0.0, cage.z)}


def why_outside(point: Position, cage: CageSize) -> str:
    """Which axis leaves the cage and by which bound; empty when the point is inside.

    A point on the boundary is inside. Written so that NaN would be outside.
    """
    for axis, (low, high) in bounds(cage).items():
        value = getattr(point, axis)
        if not low <= value <= high:
            # Rounded as people say it, unless that would read as inside.
            rounded = float(f"{value:g}")
            said = value if low <= rounded <= high else rounded
            return f"outside the cage: {axis} = {_plain(said)} is beyond [{low:g}, {high:g}]"
    return ""


def beyond(point: Position, cage: CageSize) -> float:
    """How far from the cage a point lies, m; 0 inside."""
    x = _past(point.x, -cage.x, cage.x)
    y = _past(point.y, -cage.y, cage.y)
    z = _past(point.z, 0.0, cage.z)
    return sqrt(x * x + y * y + z * z)


def _past(value: float, low: float, high: float) -> float:
    """How far a value lies beyond the nearer bound, signed; 0 between them."""
    # NaN is in no interval, and comes out as it is.
    return 0.0 if low <= value <= high else value - (high if value > high else low)


def why_below(point: Position) -> str:
    """That the point lies below the floor, cage or no cage; empty when it does not."""
    return f"below the floor: z = {_plain(point.z)} is less than 0" if point.z < 0 else ""


def _plain(value: float) -> str:
    """All digits, so that a value one rounding beyond a bound does not read as the bound."""
    return repr(value).removesuffix(".0")


REACTION = 0.5
"""Seconds until a vehicle that is told to stop brakes: a setpoint, the jerk and the lags."""
RISE = 0.4
"""Seconds for which its speed may go on to change until then."""
GENTLE = 0.05
"""Share of the deceleration that it brakes with at the least."""
SLACK = 0.1
"""Metres that a vehicle goes on whose poses do not show yet that it speeds up."""
AT_REST = 0.05
"""A vehicle slower than this (m/s) has come to rest."""


def at_rest(pose: Pose) -> bool:
    """Whether the vehicle has come to rest."""
    return dist(astuple(pose.velocity), (0, 0, 0)) < AT_REST


def soonest_stop(pose: Pose, deceleration: float) -> Position:
    """Where each axis rests (m) if from now on it brakes as hard as the vehicle can, m/s^2."""
    p, v = pose.position, pose.velocity
    k = 0.5 / deceleration
    return Position(p.x + k * v.x * abs(v.x), p.y + k * v.y * abs(v.y), p.z + k * v.z * abs(v.z))


def stopping_excess(w: World) -> float:
    """How far out of the cage (m) the vehicle can soonest come to rest."""
    return beyond(soonest_stop(w.pose, w.envelope.deceleration), w.cage)


def leeway(w: World) -> float:
    """How far out of the cage (m) a sound vehicle gets at the most that is to stop or come back.

    It may be slow to brake and brake gently; and until it brakes, its speed may go on to change as
    it did between the last two poses.
    """
    now, before = astuple(w.pose.velocity), astuple(w.last.velocity)
    seconds = w.pose.stamp - w.last.stamp
    rises = RISE / seconds if seconds > 0 else 0.0
    later = tuple(v + rises * (v - old) for v, old in zip(now, before, strict=True))
    out = max(beyond(place, w.cage) for place in (_gently(w, now), _gently(w, later)))
    return max(out, beyond(w.pose.position, w.cage))


def caged(s: Situation, w: World) -> Situation:
    """Let the vehicle come to rest as far out of the cage as it cannot help from now on."""
    return replace(s, beyond=leeway(w) + SLACK, since=w.pose.stamp)


def _gently(w: World, velocity: tuple[float, ...]) -> Position:
    x, y, z = velocity
    p = w.pose.position
    seconds = REACTION + 0.5 * sqrt(x * x + y * y + z * z) / (GENTLE * w.envelope.deceleration)
    return Position(p.x + seconds * x, p.y + seconds * y, p.z + seconds * z)
