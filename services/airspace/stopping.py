"""Stops: where a vehicle comes to rest that brakes now, at the soonest and at the latest.

A vehicle passes every point up to its stopping point, so that point has to be inside. Other
autopilots limit the approach speed in the same way: at each distance from a wall there is a speed
from which the vehicle still stops before the wall. The functions of single numbers are compiled by
numba, too, for a campaign.
"""

from math import dist, hypot, inf, sqrt

from msgspec import Struct
from msgspec.structs import astuple

from quadctl.schemas.messages import CageSize, Pose
from quadctl.services.airspace.geometry import Box, Point, place_of, velocity_of
from quadctl.services.airspace.zones import Region

AT_REST = 0.05
"""Speed (m/s) below which a vehicle has come to rest."""
REACTION = 0.5
"""Seconds from the command to stop until the vehicle brakes: a setpoint, the jerk and the lags."""
RISE = 0.4
"""Seconds of these in which its speed may still change as before."""
LAGS = 0.3
"""Seconds for which a sound vehicle's lags hide from its poses that it begins to move, or to brake."""
GENTLE, OWN = 0.05, 0.5
"""A sound vehicle brakes at least with this share of the deceleration that safety allows for, or with
this share of the acceleration that it flies with, if that is less."""
SLACK = 0.5
"""Metres that a vehicle needs which speeds up as hard as it can (5 m/s^2, 40 m/s^3) for the 0.25 s that
its lags hide from its poses, and then brakes as hard."""


class Envelope(Struct, frozen=True):
    """Limits of the vehicle's motion, m/s and m/s^2, with a margin, m; beyond, it is unreliable.

    It flies on for the time `reaction` (s) before it brakes. It speeds up with `acceleration` (m/s^2)
    at most; infinite if that is unknown.
    """

    speed: float
    deceleration: float
    margin: float
    reaction: float = 0.0
    acceleration: float = inf

    @property
    def gentle(self) -> float:
        """Return the least deceleration (m/s^2) of a sound vehicle."""
        return min(GENTLE * self.deceleration, OWN * self.acceleration)


def outside(x: float, y: float, z: float, sx: float, sy: float, sz: float) -> float:
    """Return the distance (m) of a place from a cage of this size, 0 inside."""
    dx = max(-sx - x, x - sx, 0.0)
    dy = max(-sy - y, y - sy, 0.0)
    dz = max(-z, z - sz, 0.0)
    return sqrt(dx * dx + dy * dy + dz * dz)


def soonest(p: float, v: float, deceleration: float, reaction: float) -> float:
    """Return where (m) an axis stops that brakes at this deceleration (m/s^2) after a time, s."""
    return p + reaction * v + 0.5 / deceleration * v * abs(v)


def latest(vx: float, vy: float, vz: float, braking: float) -> float:
    """Return the time (s) at the present speed to where a vehicle stops that brakes late, m/s^2."""
    return REACTION + 0.5 * sqrt(vx * vx + vy * vy + vz * vz) / braking


def risen(v: float, before: float, seconds: float) -> float:
    """Return the speed (m/s) of an axis that goes on to change as in the seconds before."""
    return v + (RISE / seconds if seconds > 0.0 else 0.0) * (v - before)


def farthest(
    x: float, y: float, z: float, vx: float, vy: float, vz: float,
    braking: float, sx: float, sy: float, sz: float,
) -> float:  # fmt: skip
    """Return how far outside the cage (m) a vehicle stops that brakes late, at this deceleration, m/s^2."""
    t = latest(vx, vy, vz, braking)
    return outside(x + t * vx, y + t * vy, z + t * vz, sx, sy, sz)


SCALAR = (outside, soonest, latest, risen, farthest)
"""Functions to be compiled, each after those that it calls."""


def at_rest(pose: Pose) -> bool:
    """Return whether the vehicle has come to rest."""
    return dist(velocity_of(pose), (0, 0, 0)) < AT_REST


def soonest_stop(pose: Pose, deceleration: float, reaction: float = 0.0) -> Point:
    """Return the stopping point (m) if each axis brakes at this deceleration (m/s^2) after a time, s."""
    (x, y, z), (vx, vy, vz) = place_of(pose), velocity_of(pose)
    return (
        soonest(x, vx, deceleration, reaction),
        soonest(y, vy, deceleration, reaction),
        soonest(z, vz, deceleration, reaction),
    )


def straight_stop(pose: Pose, deceleration: float, reaction: float = 0.0) -> Point:
    """Return the stopping point (m) on the line of flight, at this deceleration (m/s^2) after a time, s."""
    velocity = velocity_of(pose)
    return _after(place_of(pose), velocity, reaction + 0.5 * hypot(*velocity) / deceleration)


def _after(place: Point, velocity: Point, seconds: float) -> Point:
    (x, y, z), (vx, vy, vz) = place, velocity
    return x + seconds * vx, y + seconds * vy, z + seconds * vz


def latest_stops(pose: Pose, last: Pose, envelope: Envelope) -> tuple[Point, Point]:
    """Return the farthest stopping points (m) at the present speed, and as it may still change.

    A sound vehicle may brake late and gently; until then, its speed may change as since the last pose.
    """
    seconds, now = pose.stamp - last.stamp, velocity_of(pose)
    x, y, z = (risen(v, old, seconds) for v, old in zip(now, velocity_of(last), strict=True))
    here, braking = place_of(pose), envelope.gentle
    return (
        _after(here, now, latest(*now, braking)),
        _after(here, (x, y, z), latest(x, y, z, braking)),
    )


def stopping_excess(pose: Pose, cage: CageSize, region: Region, envelope: Envelope) -> float:
    """Return how far outside the cage or inside a zone (m) the vehicle soonest comes to rest.

    Each axis may stop as soon as it can, or all together on the line that the vehicle flies: beside
    a zone, only one of the two may be clear.
    """
    here, limits = place_of(pose), (envelope.deceleration, envelope.reaction)
    place = soonest_stop(pose, *limits)
    inside = region.excess(here, place) if region else 0.0
    if inside > 0:
        inside = min(inside, region.excess(here, straight_stop(pose, *limits)))
    return max(outside(*place, *astuple(cage)), inside)


def leeway(pose: Pose, last: Pose, cage: CageSize, region: Region, envelope: Envelope) -> float:
    """Return the greatest distance (m) outside the cage, or in a zone, of a sound vehicle that must stop."""
    here, size = place_of(pose), astuple(cage)
    places = (*latest_stops(pose, last, envelope), here)
    out = max(outside(*place, *size) for place in places)
    return max(out, *(region.excess(here, place) for place in places)) if region else out


def stops_in(pose: Pose, last: Pose, envelope: Envelope, motion: Box, slack: float) -> Box:
    """Return the box (m) with the place of a sound vehicle and its stop, whenever it brakes.

    It stays in the box of its motion. With `slack` (m), poses do not show yet how fast it is.
    """
    here, places = place_of(pose), latest_stops(pose, last, envelope)
    low, high = zip(
        *(
            (min(p, max(a, min(*ends) - slack)), max(p, min(b, max(*ends) + slack)))
            for p, a, b, *ends in zip(here, *motion, here, *places, strict=True)
        ),
        strict=True,
    )
    return low, high
