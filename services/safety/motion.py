"""Motion of a vehicle among zones and others: its rest, the space of its flight, and the verdict on a goal.

A way from rest is a straight line, leg by leg, unless a leg begins near the floor. A goal that comes
in flight bends the way: it is somewhere in the box around the vehicle, its stopping point and the
goal, because each axis moves between these.
"""

from collections.abc import Callable, Iterable
from enum import Enum
from itertools import chain
from math import dist, inf, isfinite

from quadctl.services.airspace.cage import why_below, why_outside
from quadctl.services.airspace.geometry import Box, Piece, Point, Space, around, away
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
from quadctl.services.airspace.separation import WIDER, Neighbour, conflicts, why_near
from quadctl.services.airspace.stopping import STANDSTILL, StoppingLaw, at_rest
from quadctl.services.safety.model import FlightPhase, GoalVerdict, Goto, Situation, World

_PART = 0.25
"""Part of a short leg: before that leg, a vehicle rests at no more than this distance from its end, too."""


class Rest(Enum):
    """How far a vehicle has come to rest."""

    NONE = "it moves, or is about to"
    AWAY = "it stands still, but not at its goal"
    NEAR = "it stands still at its place"
    SETTLED = "it does so for good: the next way from there is straight"


_IN_PLACE = Rest.NEAR, Rest.SETTLED


def rest_of(s: Situation, w: World) -> Rest:
    """Return how far the vehicle has come to rest."""
    # A slow vehicle may be about to turn round, or its setpoint may not have stopped.
    if not (at_rest(w.pose) and responded(s, w)):
        return Rest.NONE
    if not (s.brake or _is_near(s, w)):
        return Rest.AWAY
    return Rest.SETTLED if _has_settled(s, w) else Rest.NEAR


def _is_near(s: Situation, w: World) -> bool:
    """Return whether the vehicle is near its goal; wind may keep it off by the margin."""
    near = min(NEAR, _PART * dist(s.origin, s.goal)) + w.margin
    return dist(w.place, s.goal) < near


def responded(s: Situation, w: World) -> bool:
    """Return whether the vehicle's motion shows its last command by now."""
    return w.pose.stamp >= s.commanded + w.stop.response


def _has_settled(s: Situation, w: World) -> bool:
    """Return whether the vehicle has been at rest for long enough, since it shows its last command.

    On a way of some centimetres it is never faster than one at rest.
    """
    passed = w.pose.stamp - s.commanded
    return w.rested >= w.stop.settling and passed >= w.stop.settling_after_command


def stop_law(s: Situation, w: World) -> StoppingLaw:
    """Return the law of a stop; a vehicle that has settled stays, but one on its way begins to fly slowly."""
    return STANDSTILL if _has_settled(s, w) and not s.flies else w.stop


def stays(s: Situation, w: World) -> bool:
    """Return whether the vehicle is at rest at its place, and is not about to leave it."""
    return not (s.flies or s.stops) and rest_of(s, w) in _IN_PLACE


def within_cage(request: Goto, s: Situation, w: World) -> str:
    """Refuse a goal outside the cage, `virtual_cage`; while that is off, one below the floor."""
    return why_outside(request.goal, w.cage) if s.cage_on else why_below(request.goal)


LIMITS: tuple[Callable[[Goto, Situation, World], str], ...] = (within_cage,)
"""Limits on a goal, which may be no number yet: the first that returns a reason refuses it."""


def verify(s: Situation, request: Goto, w: World, *, direct: bool = False) -> GoalVerdict:
    """Return the verdict on a goal: in all limits, free of zones, and apart from other vehicles.

    The cage is convex: the straight way there stays inside, or comes nearer at every step. Zones are
    not: the way itself is checked, and unless it is to be `direct`, one around them is searched for.
    """
    route, why = _route_to(s, request.goal, w), ""
    for limit in LIMITS:
        if why := limit(request, s, w):
            return GoalVerdict(route, why)
    if s.cage_on:
        route, why = _among_zones(route, w, direct=direct)
    if why:
        return GoalVerdict(route, why)
    if near := too_near(route, s, w):
        return GoalVerdict(route, why_near(near), near)
    if all(isfinite(number) for point in route.points for number in point):
        return GoalVerdict(route)
    # A goal that is no number is in no cage, on or off.
    return GoalVerdict(route, why_outside(request.goal, w.cage) or "the goal is no place")


def too_near(route: FlightPath, s: Situation, w: World) -> list[Neighbour]:
    """Return the vehicles that a route comes too near."""
    return conflicts(w.place, space_of(route, s, w), w.others) if w.others else []


def _among_zones(route: FlightPath, w: World, *, direct: bool) -> tuple[FlightPath, str]:
    """Return the route, or one around zones, and why that is barred; empty if it is not."""
    barred, searched = why_barred(route, w.region), False
    ends_inside = w.region.why_inside(route.points[-1])
    if barred and not (direct or route.turns or ends_inside):
        start = route.points[0] if route.begun else route.origin
        corners = way_around(w.region, w.cage, start, route.points[-1])
        route, searched = _via(route, corners), True
        barred = why_barred(route, w.region)
    outside = (why_outside(corner, w.cage) for corner in route.points[:-1])
    why = next(filter(None, outside), "") or barred
    if why and not ends_inside and route.reach and not route.begun:
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
    """Return the box (m) with the vehicle and its stop: a sound vehicle stays in that of its motion.

    Once it has responded to its command, it speeds up towards its goal alone, and never passes it.
    """
    law = stop_law(s, w)
    boxes = [motion(s), law.box(w.pose)]
    if responded(s, w):
        low, high = law.steady.box(w.pose)
        if not s.brake:
            low = _ahead(w.place, s.goal, low, min)
            high = _ahead(w.place, s.goal, high, max)
        boxes.append((low, high))
    lows, highs = zip(*boxes, strict=True)
    (x, y, z), (x0, y0, z0), (x1, y1, z1) = w.place, map(max, *lows), map(min, *highs)
    return (min(x, x0), min(y, y0), min(z, z0)), (max(x, x1), max(y, y1), max(z, z1))


def _ahead(place: Point, goal: Point, ends: Point, farther: Callable[..., float]) -> Point:
    """Return the ends to one side, but the goal on each axis that has it on that side."""
    x, y, z = (
        g if p != g and farther(p, g) == g else end
        for p, g, end in zip(place, goal, ends, strict=True)
    )
    return x, y, z


def space_of(route: FlightPath, s: Situation, w: World) -> Space:
    """Return the space that a route needs."""
    if route.begun:
        return (*_left(s, w, route.points[0]), *legs(route.points))
    if route.reach:
        return (_box(route.reach, w.place), *legs(route.points))
    # A vehicle at rest may be some way off its goal, from which it starts.
    return (*line(w.place, route.origin), *legs(route.straight))


def reserved(s: Situation, w: World) -> Space:
    """Return the space that a vehicle reserves: its place, and its way until that has been flown."""
    if stays(s, w):
        return (Piece(w.place, w.place if s.brake else s.goal),)
    if s.brake and s.paused is None:
        return (Piece(*_stop_box(s, w), is_box=True),)
    goal = s.paused.goal if s.paused else s.goal
    return (*_left(s, w, goal), *legs((goal, *s.corners)))


def space_after(s: Situation, points: tuple[Point, ...], w: World) -> Space:
    """Return the space of a way that begins where the present motion ends."""
    return tuple(legs((w.place if s.brake else s.end, *points)))


def off_course(s: Situation, w: World) -> float:
    """Return how far (m) a vehicle is from where it was to be; infinite while it stops."""
    if s.stops:
        return inf
    if s.brake or stays(s, w):
        return dist(w.place, s.goal)
    return away(w.place, (Piece(*s.reach, is_box=True),) if s.reach else line(s.origin, s.goal))


def is_quiet(s: Situation, w: World) -> bool:
    """Return whether a pose that changed nothing changes nothing when it comes again, at any later time.

    A vehicle that stays in place meets conditions on its motion alone, unless it is outside its cage; and
    as it keeps its course, no other vehicle matters.
    """
    holds = s.phase is FlightPhase.HOLDING or s.phase is FlightPhase.STOPPED
    inside = not (s.cage_on and 0 < s.beyond < inf)
    return holds and inside and s.candidate is None and stays(s, w) and keeps_course(s, w)


def keeps_course(s: Situation, w: World) -> bool:
    """Return whether a vehicle is where it was to be, so that it is apart from all others."""
    return off_course(s, w) <= WIDER / 2


def _left(s: Situation, w: World, goal: Point) -> Space:
    """Return what is left of the present motion: a curve to its goal (m), or straight."""
    if not s.reach:
        return tuple(line(w.place, goal))
    return (_box(bend(*_stop_box(s, w), goal), w.place),)


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
    rest: Iterable[Piece] = ()
    if not stays(s, w):
        if s.reach and (why := w.region.why_overlaps(s.reach)):
            return why
        # It flies straight to its goal, down to the floor, too: only from rest there a leg bends.
        rest = () if s.reach else line(_abreast(s, w.place), s.goal)
    return why_crossed(chain(rest, legs(points)), w.region)


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
