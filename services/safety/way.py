"""Ways among zones: where a flight leads, from its start to its goal, and which zone bars it.

A way from rest is a straight line, leg by leg. A goal that comes in flight bends the way: it is
somewhere in the box around the vehicle, its stopping point and the goal, because each axis moves
between these.
"""

from itertools import pairwise
from math import dist
from typing import NamedTuple

from msgspec.structs import astuple

from quadctl.schemas.messages import Position
from quadctl.services.safety.cage import at_rest, latest_stop
from quadctl.services.safety.model import Situation, State, World
from quadctl.services.safety.zones import Box, Region

NEAR = 0.05
"""Distance (m) from its goal within which a vehicle at rest has reached it."""


class Way(NamedTuple):
    """Points (m) that a vehicle flies to, one by one, each from rest.

    It begins straight from `origin`, or with a curve in the box `reach`. With `begun`, the vehicle
    flies to the first point already.
    """

    origin: Position
    reach: Box | None
    points: tuple[Position, ...]
    begun: bool = False


def rests(s: Situation, w: World) -> bool:
    """Return whether the vehicle stands still, and is not about to move."""
    state = s.back if s.state is State.VERIFYING else s.state
    if state is State.MOVING or s.settling or not at_rest(w.pose):
        return False
    return s.brake or dist(astuple(w.pose.position), astuple(s.goal)) < NEAR


def way_to(s: Situation, goal: Position, corners: tuple[Position, ...], w: World) -> Way:
    """Return the way to a goal, from rest by the corners.

    A vehicle that comes to rest anyway goes on from there, unless a curve is clear of zones.
    """
    place = w.pose.position
    if rests(s, w):
        return Way(place if s.brake else s.goal, None, (*corners, goal))
    reach = around(place, latest_stop(w, motion(s)), goal)
    comes_to_rest = not s.brake and (s.back is State.HOVERING or s.takeoff)
    if s.cage_on and comes_to_rest and w.region.why_overlaps(reach):
        return Way(s.origin, s.reach, (s.goal, *corners, goal), begun=True)
    return Way(place, reach, (goal,))


def why_barred(way: Way, region: Region) -> str:
    """Return which zone bars a way or its end; empty for none."""
    if not region:
        return ""
    if why := region.why_inside(way.points[-1]):
        return why
    if way.reach and not way.begun and (why := region.why_overlaps(way.reach)):
        return why
    straight = way.points if way.reach or way.begun else (way.origin, *way.points)
    return _why_crossed(straight, region)


def why_stopped(s: Situation, w: World) -> str:
    """Return which zone bars the rest of the present way, to add to `stopped`; empty for none."""
    if not w.region:
        return ""
    for point in (s.goal, *s.corners):
        if why := w.region.why_inside(point):
            return f"the goal is now {why}"
    straight = (s.goal, *s.corners)
    if not rests(s, w):
        if s.reach and (why := w.region.why_overlaps(s.reach)):
            return why
        straight = straight if s.reach else (_abreast(s, w.pose.position), *straight)
    return _why_crossed(straight, w.region)


def _why_crossed(points: tuple[Position, ...], region: Region) -> str:
    return next(filter(None, (region.why_crosses(a, b) for a, b in pairwise(points))), "")


def motion(s: Situation) -> Box:
    """Return the box (m) that the present motion stays in, its stop included."""
    return s.reach or around(s.origin, s.paused.goal if s.paused else s.goal)


def around(*points: Position) -> Box:
    """Return the smallest box (m) with all points."""
    columns = [sorted(column) for column in zip(*map(astuple, points), strict=True)]
    (x0, *_, x1), (y0, *_, y1), (z0, *_, z1) = columns
    return (x0, y0, z0), (x1, y1, z1)


def _abreast(s: Situation, place: Position) -> Position:
    """Return the point of the present leg beside the vehicle.

    A vehicle is never on its line to the last bit; beside a wall this must not decide.
    """
    start, end, here = map(astuple, (s.origin, s.goal, place))
    way = [b - a for a, b in zip(start, end, strict=True)]
    length = sum(d * d for d in way)
    past = sum(d * (h - a) for d, h, a in zip(way, here, start, strict=True))
    t = min(max(past / length, 0.0), 1.0) if length > 0 else 0.0
    return Position(*(a + t * d for a, d in zip(start, way, strict=True)))
