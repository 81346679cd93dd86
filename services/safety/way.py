"""Ways among zones: where a flight leads, from its start to its goal, and which zone bars it.

A way from rest is a straight line, leg by leg, unless a leg begins near the floor. A goal that comes
in flight bends the way: it is somewhere in the box around the vehicle, its stopping point and the
goal, because each axis moves between these.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from math import dist, inf
from typing import NamedTuple

from msgspec.structs import astuple, replace

from quadctl.schemas.messages import Pose, Position
from quadctl.services.safety.cage import at_rest, stops_in
from quadctl.services.safety.model import Situation, State, World
from quadctl.services.safety.separation import Neighbour, Piece, Space, conflicts, distance
from quadctl.services.safety.zones import Box, Region

_NEAR, _PART = 0.03, 0.25
"""Distance (m) from the end of a leg within which a vehicle at rest has reached it, and the part of a
short leg: before that leg, it rests at no more than this distance from it, too."""
_THERE, _STILL = 0.01, 0.25
"""Distance (m) from its goal, and time (s) at rest there, from which the next way is straight: a slow
vehicle may be about to turn round, or its setpoint may not have stopped, and from there the way bends."""


HIDDEN = 0.3
"""Seconds for which a vehicle's lags hide from its poses that it begins to move."""
HOP = 0.1
"""Height (m) to which a vehicle rises first on its way along the floor, and from which it lands."""
LOW = HOP + _NEAR
"""Height (m) below which a vehicle rises first, from rest: it may be that far below its place."""


class Way(NamedTuple):
    """Points (m) that a vehicle flies to, one by one, each from rest.

    It begins straight from `origin`, or with a curve in the box `reach`. With `begun`, the vehicle
    flies to the first point already; if it `turns`, it flies somewhere else.
    """

    origin: Position
    reach: Box | None
    points: tuple[Position, ...]
    begun: bool = False
    turns: bool = False


def rests(s: Situation, w: World) -> bool:
    """Return whether the vehicle stands still, and is not about to move."""
    state = s.back if s.state is State.VERIFYING else s.state
    if state is State.MOVING or s.settling or not _stands_still(s, w):
        return False
    return s.brake or _is_within(_NEAR, s, w)


def has_settled(s: Situation, w: World) -> bool:
    """Return whether the vehicle stands still for good, so that a way from here is straight."""
    return rests(s, w) and w.rested >= _STILL and (s.brake or _is_within(_THERE, s, w))


def is_there(s: Situation, w: World) -> bool:
    """Return whether a vehicle has come to rest at its goal, and the next way from there is straight."""
    return _stands_still(s, w) and w.rested >= _STILL and _is_within(_THERE, s, w)


def _is_within(most: float, s: Situation, w: World) -> bool:
    """Return whether the vehicle is so near (m) its goal; wind may keep it off by the margin."""
    goal = astuple(s.goal)
    near = min(most, _PART * dist(astuple(s.origin), goal)) + w.envelope.margin
    return dist(astuple(w.pose.position), goal) < near


def _stands_still(s: Situation, w: World) -> bool:
    return at_rest(w.pose) and w.pose.stamp >= s.commanded + HIDDEN


def way_to(s: Situation, goal: Position, corners: tuple[Position, ...], w: World) -> Way:
    """Return the way to a goal, from rest by the corners.

    A vehicle that comes to rest anyway goes on from there, unless a curve is clear of zones and
    of other vehicles.
    """
    place = w.pose.position
    if has_settled(s, w):
        origin, points = place if s.brake else s.goal, (*corners, goal)
        return Way(origin, rise(origin, points[0]), points)
    low, high = stops_in(s, w, motion(s))
    reach = bend(Position(*low), Position(*high), goal)
    comes_to_rest = not s.brake and (s.back is State.HOVERING or s.takeoff)
    curve = Way(place, reach, (goal,), turns=True)
    barred = s.cage_on and w.region.why_overlaps(reach)
    if comes_to_rest and (barred or conflicts(astuple(place), space_of(curve, s, w), w.others)):
        return Way(s.origin, s.reach, (s.goal, *corners, goal), begun=True)
    return curve


def space_of(way: Way, s: Situation, w: World) -> Space:
    """Return the space that a way needs."""
    place = w.pose.position
    if way.begun:
        return (*_begun(s, place, way.points[0]), *legs(way.points))
    if way.reach:
        return (_box(way.reach, place), *legs(way.points))
    # A vehicle at rest may be some way off its goal, from which it starts.
    return (*_straight(place, way.origin), *legs((way.origin, *way.points)))


def too_near(
    s: Situation, goal: Position, corners: tuple[Position, ...], w: World
) -> list[Neighbour]:
    """Return the vehicles that the way to a goal comes too near."""
    if not w.others:
        return []
    space = space_of(way_to(s, goal, corners if s.cage_on else (), w), s, w)
    return conflicts(astuple(w.pose.position), space, w.others)


def reserved(s: Situation, w: World) -> Space:
    """Return the space that a vehicle reserves: its place, and its way until that has been flown."""
    place = w.pose.position
    if rests(s, w):
        return tuple(_straight(place, place if s.brake else s.goal))
    if s.brake and s.paused is None:
        return (Piece(*stops_in(s, w, motion(s)), is_box=True),)
    goal = s.paused.goal if s.paused else s.goal
    return (*_begun(s, place, goal), *legs((goal, *s.corners)))


def space_after(s: Situation, goal: Position, corners: tuple[Position, ...], w: World) -> Space:
    """Return the space of a way that begins where the present motion ends."""
    return tuple(legs((_end_of(s, w), *corners, goal)))


def _end_of(s: Situation, w: World) -> Position:
    return w.pose.position if s.brake else s.end


def off_course(s: Situation, pose: Pose) -> float:
    """Return how far (m) a vehicle is from where it was to be; infinite while it stops."""
    if s.settling:
        return inf
    place, goal = astuple(pose.position), astuple(s.goal)
    if s.brake or (s.state is State.HOVERING and dist(place, goal) < _NEAR):
        return dist(place, goal)
    return distance((Piece(place, place),), _begun(s, s.origin, s.goal), 1.0, 1.0)


def _begun(s: Situation, place: Position, goal: Position) -> Space:
    """Return the rest of the present motion, from the vehicle's place: a curve, or straight."""
    return (_box(s.reach, place),) if s.reach else tuple(_straight(place, goal))


def _box(box: Box, place: Position) -> Piece:
    low, high = around(place, *(Position(*corner) for corner in box))
    return Piece(low, high, is_box=True)


def legs(points: Iterable[Position]) -> Iterator[Piece]:
    """Yield the space of a way that begins at rest, leg by leg."""
    for a, b in pairwise(points):
        if box := rise(a, b):
            yield Piece(*box, is_box=True)
        else:
            yield from _straight(a, b)


def _straight(a: Position, b: Position) -> Iterator[Piece]:
    """Yield a straight line; to a place near the floor also the one to above it, and the landing."""
    yield Piece(astuple(a), astuple(b))
    if b.z < HOP:
        over = replace(b, z=HOP)
        yield Piece(astuple(a), astuple(over))
        yield Piece(astuple(over), astuple(b))


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


def _why_crossed(points: Iterable[Position], region: Region) -> str:
    for a, b, is_box in legs(points):
        why = (
            region.why_overlaps((a, b))
            if is_box
            else region.why_crosses(Position(*a), Position(*b))
        )
        if why:
            return why
    return ""


def rise(start: Position, end: Position) -> Box | None:
    """Return the box (m) of a leg from rest near the floor; None for any other one, which is straight.

    The vehicle rises first, and turns before it has stopped above its start.
    """
    return bend(start, end) if start.z < LOW else None


def bend(*points: Position) -> Box:
    """Return the box (m) of a bent way between points, with its hops near the floor."""
    return around(*points, *(replace(p, z=max(p.z, HOP)) for p in points))


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
