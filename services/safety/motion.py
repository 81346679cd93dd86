"""Motion of a vehicle among zones and others: its rest, the space of its flight, and the verdict on a goal.

A way from rest is a straight line, leg by leg, unless a leg begins near the floor. A goal that comes
in flight bends the way: it is somewhere in the box around the vehicle, its stopping point and the
goal, because each axis moves between these.
"""

from enum import Enum
from math import dist, inf, isfinite

from quadctl.schemas.messages import Pose
from quadctl.services.airspace.cage import why_below, why_outside
from quadctl.services.airspace.geometry import Box, Piece, Point, Space, around, distance, place_of
from quadctl.services.airspace.routes import (
    LOW,
    NEAR,
    FlightPath,
    bend,
    legs,
    line,
    rise,
    way_around,
    why_barred,
    why_crossed,
)
from quadctl.services.airspace.separation import Neighbour, conflicts, why_near
from quadctl.services.airspace.stopping import LAGS, REACTION, SLACK, at_rest, stops_in
from quadctl.services.safety.model import FlightPhase, GoalVerdict, Goto, Situation, World

_PART = 0.25
"""Part of a short leg: before that leg, a vehicle rests at no more than this distance from its end, too."""
_THERE, _STILL = 0.01, 0.25
"""Distance (m) from its goal, and time (s) at rest there, from which the next way is straight: a slow
vehicle may be about to turn round, or its setpoint may not have stopped, and from there the way bends."""


class Rest(Enum):
    """How far a vehicle has come to rest."""

    NONE = "it moves, or is about to"
    AWAY = "it stands still, but not at its goal"
    NEAR = "it stands still at its place"
    SETTLED = "it does so for good: the next way from there is straight"


def rest_of(s: Situation, w: World) -> Rest:
    """Return how far the vehicle has come to rest."""
    if not (at_rest(w.pose) and w.pose.stamp >= s.commanded + LAGS):
        return Rest.NONE
    if not (s.brake or _is_within(NEAR, s, w)):
        return Rest.AWAY
    settled = w.rested >= _STILL and (s.brake or _is_within(_THERE, s, w))
    return Rest.SETTLED if settled else Rest.NEAR


def _is_within(most: float, s: Situation, w: World) -> bool:
    """Return whether the vehicle is so near (m) its goal; wind may keep it off by the margin."""
    near = min(most, _PART * dist(s.origin, s.goal)) + w.envelope.margin
    return dist(w.place, s.goal) < near


def stays(s: Situation, w: World) -> bool:
    """Return whether the vehicle is at rest at its place, and is not about to leave it."""
    return not (s.flies or s.stops) and rest_of(s, w) in {Rest.NEAR, Rest.SETTLED}


def verify(s: Situation, request: Goto, w: World, *, direct: bool = False) -> GoalVerdict:
    """Return the verdict on a goal: inside the box, free of zones, and apart from other vehicles.

    The box is convex: the straight way there stays inside, or comes nearer at every step. Zones are
    not: the way itself is checked, and unless it is to be `direct`, one around them is searched for.
    """
    goal = request.goal
    route = _route_to(s, goal, w)
    if not s.cage_on:
        why = why_below(goal)
    elif not (why := why_outside(goal, w.cage)):
        route, why = _among_zones(route, w, direct=direct)
    if why:
        return GoalVerdict(route, why)
    if near := too_near(route, s, w):
        return GoalVerdict(route, why_near(near), near)
    if all(isfinite(number) for point in route.points for number in point):
        return GoalVerdict(route)
    # A goal that is no number is in no cage, on or off.
    return GoalVerdict(route, why_outside(goal, w.cage) or "the goal is no place")


def too_near(route: FlightPath, s: Situation, w: World) -> list[Neighbour]:
    """Return the vehicles that a route comes too near."""
    return conflicts(w.place, space_of(route, s, w), w.others) if w.others else []


def _among_zones(route: FlightPath, w: World, *, direct: bool) -> tuple[FlightPath, str]:
    """Return the route, or one around zones, and why that is barred; empty if it is not."""
    barred, searched = why_barred(route, w.region), False
    if barred and not (direct or route.turns or w.region.why_inside(route.points[-1])):
        start = route.points[0] if route.begun else route.origin
        corners = way_around(w.region, w.cage, start, route.points[-1])
        route, searched = _via(route, corners), True
        barred = why_barred(route, w.region)
    outside = (why_outside(corner, w.cage) for corner in route.points[:-1])
    why = next(filter(None, outside), "") or barred
    if why and route.reach and not route.begun:
        if route.origin[2] < LOW:
            return route, f"{why}: from the floor a way bends; rise first"
        return route, f"{why}: in flight a way bends, from rest it may be free; hold first"
    return route, f"{why}; no way around it was found" if why and searched else why


def _route_to(s: Situation, goal: Point, w: World) -> FlightPath:
    """Return the route to a goal.

    A vehicle that comes to rest anyway goes on from there, unless a curve is clear of zones and
    of other vehicles.
    """
    if not (s.flies or s.stops) and rest_of(s, w) is Rest.SETTLED:
        origin = w.place if s.brake else s.goal
        return FlightPath(origin, rise(origin, goal), (goal,))
    low, high = _stop_box(s, w)
    reach = bend(low, high, goal)
    curve = FlightPath(w.place, reach, (goal,), turns=True)
    comes_to_rest = s.phase is FlightPhase.HOLDING or s.phase is FlightPhase.TAKING_OFF
    barred = s.cage_on and w.region.why_overlaps(reach)
    if comes_to_rest and (barred or conflicts(w.place, space_of(curve, s, w), w.others)):
        return FlightPath(s.origin, s.reach, (s.goal, goal), begun=True)
    return curve


def _via(route: FlightPath, corners: tuple[Point, ...]) -> FlightPath:
    """Return a route from rest that leads by corners."""
    points = (*route.points[:-1], *corners, route.points[-1])
    reach = route.reach if route.begun else rise(route.origin, points[0])
    return route._replace(points=points, reach=reach)


def _stop_box(s: Situation, w: World) -> Box:
    """Return the box (m) with the vehicle and its stop.

    In the first half second after a command its poses do not show how fast it is.
    """
    slack = SLACK if w.pose.stamp < s.commanded + REACTION else 0.0
    return stops_in(w.pose, w.last, w.envelope, motion(s), slack)


def space_of(route: FlightPath, s: Situation, w: World) -> Space:
    """Return the space that a route needs."""
    if route.begun:
        return (*_begun(s, w.place, route.points[0]), *legs(route.points))
    if route.reach:
        return (_box(route.reach, w.place), *legs(route.points))
    # A vehicle at rest may be some way off its goal, from which it starts.
    return (*line(w.place, route.origin), *legs(route.straight))


def reserved(s: Situation, w: World) -> Space:
    """Return the space that a vehicle reserves: its place, and its way until that has been flown."""
    if stays(s, w):
        return tuple(line(w.place, w.place if s.brake else s.goal))
    if s.brake and s.paused is None:
        return (Piece(*_stop_box(s, w), is_box=True),)
    goal = s.paused.goal if s.paused else s.goal
    return (*_begun(s, w.place, goal), *legs((goal, *s.corners)))


def space_after(s: Situation, points: tuple[Point, ...], w: World) -> Space:
    """Return the space of a way that begins where the present motion ends."""
    return tuple(legs((w.place if s.brake else s.end, *points)))


def off_course(s: Situation, pose: Pose) -> float:
    """Return how far (m) a vehicle is from where it was to be; infinite while it stops."""
    if s.stops:
        return inf
    place = place_of(pose)
    away = dist(place, s.goal)
    if s.brake or (s.phase is FlightPhase.HOLDING and away < NEAR):
        return away
    return distance((Piece(place, place),), _begun(s, s.origin, s.goal), 1.0, 1.0)


def _begun(s: Situation, place: Point, goal: Point) -> Space:
    """Return the rest of the present motion, from the vehicle's place: a curve, or straight."""
    return (_box(s.reach, place),) if s.reach else tuple(line(place, goal))


def _box(box: Box, place: Point) -> Piece:
    return Piece(*around(place, *box), is_box=True)


def why_excluded(s: Situation, w: World) -> str:
    """Return why the cage or a zone bars the rest of the present way, to add to `stopped`; empty if not."""
    outside = (why_outside(point, w.cage) for point in (s.goal, *s.corners))
    why = next(filter(None, outside), "")
    return f"the goal is now {why}" if why else _why_zoned(s, w)


def _why_zoned(s: Situation, w: World) -> str:
    """Return which zone bars the rest of the present way; empty for none."""
    if not w.region:
        return ""
    points = (s.goal, *s.corners)
    for point in points:
        if why := w.region.why_inside(point):
            return f"the goal is now {why}"
    if not stays(s, w):
        if s.reach and (why := w.region.why_overlaps(s.reach)):
            return why
        points = points if s.reach else (_abreast(s, w.place), *points)
    return why_crossed(points, w.region)


def motion(s: Situation) -> Box:
    """Return the box (m) that the present motion stays in, its stop included."""
    return s.reach or around(s.origin, s.paused.goal if s.paused else s.goal)


def _abreast(s: Situation, place: Point) -> Point:
    """Return the point of the present leg beside the vehicle.

    A vehicle is never on its line to the last bit; beside a wall this must not decide.
    """
    (ax, ay, az), (bx, by, bz), (x, y, z) = s.origin, s.goal, place
    dx, dy, dz = bx - ax, by - ay, bz - az
    length = dx * dx + dy * dy + dz * dz
    past = dx * (x - ax) + dy * (y - ay) + dz * (z - az)
    t = min(max(past / length, 0.0), 1.0) if length > 0 else 0.0
    return ax + t * dx, ay + t * dy, az + t * dz
