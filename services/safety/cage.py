"""Virtual cage, and the stopping distance of a vehicle in it.

A vehicle passes every point up to its stopping point, so that point has to be inside. Other
autopilots limit the approach speed in the same way: at each distance from a wall there is a speed
from which the vehicle still stops before the wall.
"""

from math import dist, hypot, sqrt

from msgspec.structs import astuple, replace

from quadctl.schemas.messages import CageSize, Pose, Position
from quadctl.services.safety.model import Envelope, Situation, World
from quadctl.services.safety.zones import Box, Nearest

Interval = tuple[float, float]


def bounds(cage: CageSize) -> dict[str, Interval]:
    """Return the interval of each axis, m."""
    return {"x": (-cage.x, cage.x), "y": (-cage.y, cage.y), "z": (0.0, cage.z)}


def why_outside(point: Position, cage: CageSize) -> str:
    """Return which axis leaves the cage by which bound; empty if the point is inside.

    A point on the boundary is inside. NaN is outside.
    """
    for axis, (low, high) in bounds(cage).items():
        value = getattr(point, axis)
        if not low <= value <= high:
            # Rounded for readers, unless the rounded value would be inside.
            rounded = float(f"{value:g}")
            shown = value if low <= rounded <= high else rounded
            return f"outside the cage: {axis} = {_plain(shown)} is beyond [{low:g}, {high:g}]"
    return ""


def beyond(point: Position, cage: CageSize) -> float:
    """Return the distance (m) of a point from the cage, 0 inside."""
    x = _past(point.x, -cage.x, cage.x)
    y = _past(point.y, -cage.y, cage.y)
    z = _past(point.z, 0.0, cage.z)
    return sqrt(x * x + y * y + z * z)


def _past(value: float, low: float, high: float) -> float:
    """Return a value's signed distance beyond the nearer bound; 0 between the bounds."""
    # NaN is in no interval, and stays NaN.
    return 0.0 if low <= value <= high else value - (high if value > high else low)


def why_below(point: Position) -> str:
    """Return the reason if the point is below the floor, cage or no cage; else an empty string."""
    return f"below the floor: z = {_plain(point.z)} is less than 0" if point.z < 0 else ""


def _plain(value: float) -> str:
    """Return all digits, so that a value barely beyond a bound does not read as the bound."""
    return repr(value).removesuffix(".0")


REACTION = 0.5
"""Seconds from the command to stop until the vehicle brakes: a setpoint, the jerk and the lags."""
RISE = 0.4
"""Seconds of these in which its speed may still change as before."""
GENTLE, OWN = 0.05, 0.5
"""A sound vehicle brakes at least with this share of the deceleration that safety allows for, or with
this share of the acceleration that it flies with, if that is less."""
SLACK = 0.5
"""Metres that a vehicle needs which speeds up as hard as it can (5 m/s^2, 40 m/s^3) for the 0.25 s that
its lags hide from its poses, and then brakes as hard."""
AT_REST = 0.05
"""Speed (m/s) below which a vehicle has come to rest."""


def at_rest(pose: Pose) -> bool:
    """Return whether the vehicle has come to rest."""
    return dist(astuple(pose.velocity), (0, 0, 0)) < AT_REST


def soonest_stop(pose: Pose, deceleration: float, reaction: float = 0.0) -> Position:
    """Return the stopping point (m) if each axis brakes at this deceleration (m/s^2) after a time, s."""
    p, v = pose.position, pose.velocity
    k = 0.5 / deceleration
    return Position(
        p.x + reaction * v.x + k * v.x * abs(v.x),
        p.y + reaction * v.y + k * v.y * abs(v.y),
        p.z + reaction * v.z + k * v.z * abs(v.z),
    )


def straight_stop(pose: Pose, deceleration: float, reaction: float = 0.0) -> Position:
    """Return the stopping point (m) on the line of flight, at this deceleration (m/s^2) after a time, s."""
    p, v = pose.position, pose.velocity
    seconds = reaction + 0.5 * hypot(v.x, v.y, v.z) / deceleration
    return Position(p.x + seconds * v.x, p.y + seconds * v.y, p.z + seconds * v.z)


def stopping_excess(w: World) -> float:
    """Return how far outside the cage or inside a zone (m) the vehicle soonest comes to rest.

    Each axis may stop as soon as it can, or all together on the line that the vehicle flies: beside
    a zone, only one of the two may be clear.
    """
    here, limits = w.pose.position, (w.envelope.deceleration, w.envelope.reaction)
    place = soonest_stop(w.pose, *limits)
    inside = w.region.excess(here, place) if w.region else 0.0
    if inside > 0:
        inside = min(inside, w.region.excess(here, straight_stop(w.pose, *limits)))
    return max(beyond(place, w.cage), inside)


def _excess(w: World, place: Position) -> float:
    """Return how far (m) the way to a place leads out of the cage or into a zone."""
    out = beyond(place, w.cage)
    return max(out, w.region.excess(w.pose.position, place)) if w.region else out


def nearest(w: World) -> Nearest:
    """Return the wall of the cage or of a zone that is nearest to the vehicle; the floor is none."""
    p, cage = w.pose.position, w.cage
    box = Nearest("cage", min(cage.x - abs(p.x), cage.y - abs(p.y), cage.z - p.z))
    zone = w.region.nearest(p) if w.region else None
    return zone if zone and zone.distance < box.distance else box


def leeway(w: World) -> float:
    """Return the greatest distance (m) outside the cage, or in a zone, of a sound vehicle that must stop.

    It may brake late and gently; until then, its speed may change as between the last two poses.
    """
    out = max(_excess(w, place) for place in _latest(w))
    return max(out, _excess(w, w.pose.position))


def stops_in(s: Situation, w: World, motion: Box) -> Box:
    """Return the box (m) with the place of a sound vehicle and its stop, whenever it brakes.

    It stays in the box of its motion. In the first half second after a command its poses do not
    show how fast it is.
    """
    here, places = astuple(w.pose.position), [astuple(place) for place in _latest(w)]
    slack = SLACK if w.pose.stamp < s.commanded + REACTION else 0.0
    low, high = zip(
        *(
            (min(p, max(a, min(*ends) - slack)), max(p, min(b, max(*ends) + slack)))
            for p, a, b, *ends in zip(here, *motion, here, *places, strict=True)
        ),
        strict=True,
    )
    return low, high


def _latest(w: World) -> tuple[Position, Position]:
    """Return the farthest stopping points (m) at the present speed, and as it may still change."""
    now, before = astuple(w.pose.velocity), astuple(w.last.velocity)
    seconds = w.pose.stamp - w.last.stamp
    rises = RISE / seconds if seconds > 0 else 0.0
    later = tuple(v + rises * (v - old) for v, old in zip(now, before, strict=True))
    return _gently(w, now), _gently(w, later)


def caged(s: Situation, w: World) -> Situation:
    """Allow the vehicle to come to rest as far outside the cage as it now has to."""
    return replace(s, beyond=leeway(w) + SLACK, since=w.pose.stamp)


def gentle(envelope: Envelope) -> float:
    """Return the least deceleration (m/s^2) of a sound vehicle."""
    return min(GENTLE * envelope.deceleration, OWN * envelope.acceleration)


def _gently(w: World, velocity: tuple[float, ...]) -> Position:
    x, y, z = velocity
    p = w.pose.position
    seconds = REACTION + 0.5 * sqrt(x * x + y * y + z * z) / gentle(w.envelope)
    return Position(p.x + seconds * x, p.y + seconds * y, p.z + seconds * z)
