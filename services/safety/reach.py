"""Where the vehicle can soonest come to rest, and whether that is in the cage.

Nothing keeps it from passing the points up to there, so this is what has to stay inside, as in
the approach speeds of other autopilots: at each distance from a wall there is a speed from which
it still stops before it.
"""

from math import dist

from msgspec.structs import astuple

from schemas.geometry import Position
from schemas.messages import Pose
from services.safety.cage import beyond, excess
from services.safety.model import World

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


def reach(w: World) -> float:
    """How far out of the cage (m) the vehicle can soonest come to rest."""
    return beyond(soonest_stop(w.pose, w.envelope.deceleration), w.cage)


def slowing(w: World) -> bool:
    """Whether its speed outwards has fallen since the pose before, or it comes nearer."""
    x, y, z = excess(soonest_stop(w.pose, w.envelope.deceleration), w.cage)
    now, before = w.pose.velocity, w.last.velocity
    outwards = x * now.x + y * now.y + z * now.z
    return outwards <= 0 or outwards < x * before.x + y * before.y + z * before.z
