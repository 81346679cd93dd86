"""Routes among zones: the space of their legs, which zone bars them, and a way around zones.

A leg from rest is a straight line, unless it begins near the floor. The search for a way around is for
each height at which zones begin or end: past their corners, or over their tops. It starts with the zones
on the straight way, and adds those that the way found crosses. It is only a proposal, in floating point:
safety verifies each leg of it, exactly.
"""

from collections.abc import Iterable, Iterator, Sequence
from heapq import heappop, heappush
from itertools import combinations, pairwise
from math import cos, dist, hypot, inf, pi, sin
from typing import NamedTuple

from quadctl.schemas.zones import Edge, edges_of
from quadctl.services.airspace.cage import Cage
from quadctl.services.airspace.geometry import Box, Piece, Point, around
from quadctl.services.airspace.zones import Column, Region, side, touched

NEAR = 0.03
"""Distance (m) from the end of a leg within which a vehicle at rest has reached it."""
HOP = 0.1
"""Height (m) to which a vehicle rises first on its way along the floor, and from which it lands."""
LOW = HOP + NEAR
"""Height (m) below which a vehicle rises first, from rest: it may be that far below its place."""
CLEARANCE = 0.05
"""Distance (m) that a way keeps from the zones it passes: more than a vehicle strays in still air."""
_TIGHT = 0.005
"""Clearance (m) in gaps through which there is no other way."""
_ROUND = 16
"""Corners of the outline around a circle, and around a polygon with more of them."""
_MOST_LOOKS = 4000
"""Looks from one point to another at a zone with few corners; one with many counts more. They take
some 50 ms, less than a setpoint may be late."""

Corner = tuple[float, float]


class FlightPath(NamedTuple):
    """Points (m) that a vehicle flies to, one by one, each from rest.

    It begins straight from `origin`, or with a curve in the box `reach`. With `begun`, the vehicle
    flies to the first point already; if it `turns`, it flies somewhere else.
    """

    origin: Point
    reach: Box | None
    points: tuple[Point, ...]
    begun: bool = False
    turns: bool = False

    @property
    def ahead(self) -> tuple[Point, ...]:
        """Return the points after the start, or after the end of the present flight."""
        return self.points[1:] if self.begun else self.points

    @property
    def straight(self) -> tuple[Point, ...]:
        """Return the points between which it is straight, but for hops near the floor."""
        return self.points if self.reach or self.begun else (self.origin, *self.points)


def legs(points: Iterable[Point]) -> Iterator[Piece]:
    """Yield the space of a way that begins at rest, leg by leg."""
    for a, b in pairwise(points):
        if box := rise(a, b):
            yield Piece(*box, is_box=True)
        else:
            yield from line(a, b)


def line(a: Point, b: Point) -> Iterator[Piece]:
    """Yield a straight line; to a place near the floor also the one to above it, and the landing."""
    yield Piece(a, b)
    if b[2] < HOP:
        over = (*b[:2], HOP)
        yield Piece(a, over)
        yield Piece(over, b)


def rise(start: Point, end: Point) -> Box | None:
    """Return the box (m) of a leg from rest near the floor; None for any other one, which is straight.

    The vehicle rises first, and turns before it has stopped above its start. One that flies straight up
    does not turn.
    """
    return bend(start, end) if start[2] < LOW and start[:2] != end[:2] else None


def bend(*points: Point) -> Box:
    """Return the box (m) of a bent way between points, with its hops near the floor."""
    return around(*points, *((x, y, max(z, HOP)) for x, y, z in points))


def why_barred(route: FlightPath, region: Region) -> str:
    """Return which zone bars a route or its end; empty for none."""
    if not region:
        return ""
    if why := region.why_inside(route.points[-1]):
        return why
    if route.reach and not route.begun and (why := region.why_overlaps(route.reach)):
        return why
    return why_crossed(legs(route.straight), region)


def why_crossed(way: Iterable[Piece], region: Region) -> str:
    """Return which zone bars a way; empty for none."""
    for a, b, is_box in way:
        if why := region.why_overlaps((a, b)) if is_box else region.why_crosses(a, b):
            return why
    return ""


class _SpentError(Exception):
    """Every look is spent."""


def way_around(region: Region, cage: Cage, start: Point, goal: Point) -> tuple[Point, ...]:
    """Return the corners (m) of the shortest way around the zones; none if none was found."""
    search = _Search(region, cage)
    try:
        for clearance, rough in ((CLEARANCE, True), (_TIGHT, False)):
            if found := search.way(start, goal, clearance, rough=rough):
                return found
    except _SpentError:
        pass  # as good as none: a user can give points between
    return ()


class _Search:
    """Search for one way; counts its looks at zones."""

    def __init__(self, region: Region, cage: Cage) -> None:
        self._region, self._cage, self._left = region, cage, _MOST_LOOKS

    def way(self, start: Point, goal: Point, clearance: float, *, rough: bool) -> tuple[Point, ...]:
        """Return the corners of the shortest way; none if there is none.

        With `rough`, an outline with fewer corners replaces that of a polygon with many.
        """
        zones = self._crossed((start, goal))
        while True:
            corners = [corner for zone in zones for corner in outline(zone, clearance, rough=rough)]
            corners += _gates(self._region.inclusions, clearance)
            inside = [
                (x, y) for x, y in corners if abs(x) <= self._cage.x and abs(y) <= self._cage.y
            ]
            found = self._shortest(zones, inside, start, goal, clearance)
            more = [zone for zone in self._crossed(found) if zone not in zones]
            if not more:
                return found[1:-1]
            zones += more

    def _crossed(self, points: tuple[Point, ...]) -> list[Column]:
        legs = list(pairwise(points))
        exclusions = self._region.exclusions
        return [zone for zone in exclusions if any(self._cuts(zone, a, b) for a, b in legs)]

    def _cuts(self, zone: Column, a: Point, b: Point) -> bool:
        self._left -= 1 + len(zone.edges) // 32
        if self._left < 0:
            raise _SpentError
        return cuts(zone, a, b)

    def _shortest(
        self,
        zones: list[Column],
        corners: list[Corner],
        start: Point,
        goal: Point,
        clearance: float,
    ) -> tuple[Point, ...]:
        """Return the shortest way among these zones, of those at each height; none for none."""
        best: tuple[float, tuple[Point, ...]] = (inf, ())
        across = hypot(goal[0] - start[0], goal[1] - start[1])
        heights = {start[2], goal[2]}
        heights.update(z for zone in zones for z in (zone.high + clearance, zone.low - clearance))
        heights.update(z for zone in self._region.inclusions for z in (zone.high, zone.low))
        bounds = sorted(
            (hypot(across, abs(start[2] - z) + abs(goal[2] - z)), z)
            for z in {max(z, LOW) for z in heights if 0 <= z <= self._cage.z}
        )
        for least, z in bounds:
            if least < best[0]:
                best = min(best, self._at(z, zones, corners, start, goal))
        return best[1]

    def _at(
        self, z: float, zones: list[Column], corners: list[Corner], start: Point, goal: Point
    ) -> tuple[float, tuple[Point, ...]]:
        """Return length (m) and points of the shortest way past the corners at one height: A*."""
        over = [(start[0], start[1], z), (goal[0], goal[1], z)]
        nodes = [goal, *over, *((x, y, z) for x, y in corners)]
        # From near the floor a leg bends, unless it is a climb.
        begin = (start, over[0]) if start[2] < LOW else (start,)
        length = dist(start, begin[-1])
        waiting: list[tuple[float, float, tuple[Point, ...]]] = [(0.0, length, begin)]
        done: set[Point] = set()
        while waiting:
            _, length, way = heappop(waiting)
            here = way[-1]
            # A leg is looked at only now: most are never needed.
            if here in done or (len(way) > 1 and not self._is_clear(zones, way[-2], here)):
                continue
            if here == goal:
                return length, way
            done.add(here)
            for node in nodes:
                if node not in done:
                    longer = length + dist(here, node)
                    heappush(waiting, (longer + dist(node, goal), longer, (*way, node)))
        return inf, ()

    def _is_clear(self, zones: list[Column], a: Point, b: Point) -> bool:
        return not any(self._cuts(zone, a, b) for zone in zones) and self._region.stays(a, b)


def cuts(zone: Column, p: Point, q: Point) -> bool:
    """Return whether the straight way from p to q has a point inside a zone, but for rounding."""
    (px, py, pz), (qx, qy, qz) = p, q
    if (
        max(px, qx) <= zone.west or min(px, qx) >= zone.east
        or max(py, qy) <= zone.south or min(py, qy) >= zone.north
        or max(pz, qz) <= zone.low or min(pz, qz) >= zone.high
    ):  # fmt: skip
        return False
    dx, dy, dz = qx - px, qy - py, qz - pz
    first, last = 0.0, 1.0
    if dz:
        bounds = max(zone.low, min(pz, qz)), min(zone.high, max(pz, qz))
        first, last = sorted((z - pz) / dz for z in bounds)
    if not dx and not dy:
        return side(zone, px, py) > 0
    if not zone.edges:
        ox, oy = px - zone.x, py - zone.y
        t = min(max(-(ox * dx + oy * dy) / (dx * dx + dy * dy), first), last)
        return hypot(ox + t * dx, oy + t * dy) < zone.radius
    marks = {first, last}
    for ax, ay, bx, by in touched(zone.edges, px, py, qx, qy):
        ex, ey = bx - ax, by - ay
        if turned := dx * ey - dy * ex:
            marks.add(((ax - px) * ey - (ay - py) * ex) / turned)
    inner = sorted(t for t in marks if first <= t <= last)
    middles = (0.5 * (a + b) for a, b in pairwise(inner))
    return any(side(zone, px + t * dx, py + t * dy) > 0 for t in middles)


def outline(zone: Column, clearance: float, *, rough: bool) -> list[Corner]:
    """Return the corners (m) around a zone at a distance; inside it at a negative one."""
    if not zone.edges:
        reach = (zone.radius + clearance) / (cos(pi / _ROUND) if clearance > 0 else 1.0)
        angles = (2 * pi * n / _ROUND for n in range(_ROUND))
        return [(zone.x + reach * cos(a), zone.y + reach * sin(a)) for a in angles]
    if rough and len(zone.edges) > _ROUND:
        return _hull(zone, clearance)
    area = sum(ax * by - bx * ay for ax, ay, bx, by in zone.edges)
    outwards = clearance if area > 0 else -clearance
    return [
        (one[2] + outwards * x, one[3] + outwards * y)
        for one, other in zip(zone.edges, (*zone.edges[1:], zone.edges[0]), strict=True)
        for x, y in (_mitre(one, other),)
    ]


def _mitre(one: Edge, other: Edge) -> Corner:
    """Return the way (m) that keeps 1 m to the right of both edges at their corner; 4 m at most."""
    normals = []
    for ax, ay, bx, by in (one, other):
        length = hypot(bx - ax, by - ay)
        normals.append(((by - ay) / length, (ax - bx) / length))
    (ux, uy), (vx, vy) = normals
    share = 1.0 / max(1.0 + ux * vx + uy * vy, 0.125)
    return share * (ux + vx), share * (uy + vy)


def _hull(zone: Column, clearance: float) -> list[Corner]:
    """Return the corners of a polygon with sides in `_ROUND` directions around a zone."""
    angles = [2 * pi * n / _ROUND for n in range(_ROUND)]
    reach = [max(x * cos(a) + y * sin(a) for x, y, _, _ in zone.edges) + clearance for a in angles]
    step = 2 * pi / _ROUND
    return [
        (r * cos(a) - t * sin(a), r * sin(a) + t * cos(a))
        for a, r, following in zip(angles, reach, (*reach[1:], reach[0]), strict=True)
        for t in ((following - r * cos(step)) / sin(step),)
    ]


def _gates(zones: Sequence[Column], clearance: float) -> Iterator[Corner]:
    """Yield points by which a way in inclusion zones may turn, or come from one to the next."""
    outlines = [outline(zone, -clearance, rough=False) for zone in zones]
    for corners in outlines:
        yield from corners
    for one, other in combinations(map(edges_of, outlines), 2):
        for ax, ay, bx, by in one:
            for cx, cy, dx, dy in other:
                ex, ey, fx, fy = bx - ax, by - ay, dx - cx, dy - cy
                if turned := ex * fy - ey * fx:
                    t = ((cx - ax) * fy - (cy - ay) * fx) / turned
                    u = ((cx - ax) * ey - (cy - ay) * ex) / turned
                    if 0 <= t <= 1 and 0 <= u <= 1:
                        yield ax + t * ex, ay + t * ey
