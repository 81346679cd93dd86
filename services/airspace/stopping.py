"""Stops: where a vehicle comes to rest that brakes now, at the soonest, and all of where it may.

A vehicle's stop is described by four figures, after the idea of responsibility-sensitive safety
(Shalev-Shwartz, Shammah, Shashua, "On a Formal Model of Safe and Scalable Self-driving Cars", 2017): its
response, the most acceleration during it, and the least and the most deceleration after it. The first
three bound the space that a sound vehicle needs. The last one is for the guard: from where even the
hardest stop would end outside, the vehicle can no longer stop inside.
"""

from math import dist, hypot, inf, sqrt

from msgspec import Struct

from quadctl.schemas.messages import Pose
from quadctl.services.airspace.cage import Cage, bounds
from quadctl.services.airspace.geometry import Box, Point, place_of, velocity_of
from quadctl.services.airspace.zones import Region

AT_REST = 0.05
"""Speed (m/s) below which a vehicle has come to rest."""
PATIENCE = 1.0
"""Time (s) at a standstill on its way to a goal after which a vehicle does not follow."""


class StoppingLaw(Struct, frozen=True):
    """Bounds of a sound vehicle's stop.

    For the time `response` (s) after its newest pose it may still speed up with `acceleration`, then it
    brakes with `deceleration` at least (m/s^2), the magnitude of a vector that all axes share.
    """

    response: float
    acceleration: float
    deceleration: float

    def reach(self, towards: float, speed: float) -> float:
        """Return how far (m) to one side a stop may lead, at this speed (m/s) towards it and in all.

        All axes come to rest together: in the time that the whole speed takes.
        """
        gained = self.acceleration * self.response
        if towards + gained <= 0:
            return 0.0
        braking = (speed + gained) / self.deceleration
        way = (towards + 0.5 * gained) * self.response + 0.5 * (towards + gained) * braking
        return max(way, 0.0)

    def box(self, pose: Pose) -> Box:
        """Return the box (m) with the place of a sound vehicle and its stop, whenever it brakes."""
        velocity = velocity_of(pose)
        speed = hypot(*velocity)
        low, high = zip(
            *(
                (p - self.reach(-v, speed), p + self.reach(v, speed))
                for p, v in zip(place_of(pose), velocity, strict=True)
            ),
            strict=True,
        )
        return low, high

    @property
    def settling(self) -> float:
        """Return the time (s) at rest after which a vehicle that was about to stop has stopped for good."""
        return self.response + AT_REST / self.deceleration

    @property
    def settling_after_command(self) -> float:
        """Return the time (s) after a command in which a vehicle at rest may yet be about to move, or settles."""
        return self.response + self.settling

    @property
    def steady(self) -> "StoppingLaw":
        """Return the law of a vehicle that speeds up no more."""
        return StoppingLaw(self.response, 0.0, self.deceleration)

    def declared(self, reaction: float, acceleration: float, deceleration: float) -> "StoppingLaw":
        """Return the law that `[safety]` declares; without a deceleration, this one after the reaction (s)."""
        if deceleration:
            return StoppingLaw(reaction, acceleration, deceleration)
        return StoppingLaw(self.response + reaction, self.acceleration, self.deceleration)

    def wider(self, other: "StoppingLaw") -> "StoppingLaw":
        """Return the law that covers the stops of both."""
        return StoppingLaw(
            max(self.response, other.response),
            max(self.acceleration, other.acceleration),
            min(self.deceleration, other.deceleration),
        )


STANDSTILL = StoppingLaw(0.0, 0.0, inf)
"""Law of a vehicle at rest that is not about to move."""


def outside(x: float, y: float, z: float, sx: float, sy: float, sz: float) -> float:
    """Return the distance (m) of a place from a cage of this size, 0 inside."""
    dx = max(-sx - x, x - sx, 0.0)
    dy = max(-sy - y, y - sy, 0.0)
    dz = max(-z, z - sz, 0.0)
    return sqrt(dx * dx + dy * dy + dz * dz)


def soonest(p: float, v: float, deceleration: float, reaction: float) -> float:
    """Return where (m) an axis stops that brakes at this deceleration (m/s^2) after a time, s."""
    return p + reaction * v + 0.5 / deceleration * v * abs(v)


SCALAR = (outside, soonest)
"""Functions to be compiled, too, for a campaign."""


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
    (x, y, z), (vx, vy, vz) = place_of(pose), velocity_of(pose)
    t = reaction + 0.5 * hypot(vx, vy, vz) / deceleration
    return x + t * vx, y + t * vy, z + t * vz


def leeway(pose: Pose, cage: Cage, region: Region, law: StoppingLaw) -> float:
    """Return the greatest distance (m) outside the cage, or in a zone, of a sound vehicle that must stop."""
    here, box = place_of(pose), law.box(pose)
    out = hypot(
        *(
            max(least - low, high - most, 0.0)
            for (least, most), low, high in zip(bounds(cage).values(), *box, strict=True)
        )
    )
    if region and region.why_overlaps(box):
        # No place in the box is deeper in a zone than the vehicle by more than it is away from it.
        away = hypot(*(max(p - low, high - p) for p, low, high in zip(here, *box, strict=True)))
        out = max(out, region.excess(here, here) + away)
    return out
