"""Geometry of zones: places, straight ways and boxes against columns of space.

A boundary belongs to the allowed side: an exclusion zone is open, an inclusion zone closed. Each
decision is exact: floating point decides what is clear, rational numbers the rest, so all machines
decide alike. Depths and distances are plain floating point.
"""

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from math import dist, hypot, inf, isqrt
from typing import NamedTuple

from msgspec import Struct

from quadctl.schemas.zones import CAGE_NAME, FARTHEST, Edge, ZoneParams, edges_of, turn
from quadctl.services.airspace.cage import Cage
from quadctl.services.airspace.geometry import Box, Point

Span = tuple[Fraction, Fraction]
"""Part of a straight way, from 0 at its start to 1 at its end."""

_DOUBT = 1e-11
"""Share of a squared length within which a comparison with a circle needs rational numbers."""
_FINE = 1 << 80
"""Parts of a way to which its crossing with a circle is rounded, towards the inside."""


class Column(Struct, frozen=True):
    """Column over a polygon's `edges`, or over a circle if there are none; m."""

    name: str
    edges: tuple[Edge, ...]
    x: float
    y: float
    radius: float
    low: float
    high: float
    west: float
    south: float
    east: float
    north: float


def zone_of(params: ZoneParams) -> Column:
    """Return the geometry of a zone's parameters."""
    low = -inf if params.floor == -FARTHEST else float(params.floor)
    high = inf if params.ceiling == FARTHEST else float(params.ceiling)
    if not params.polygon:
        circle = params.circle
        x, y, r = float(circle.x), float(circle.y), float(circle.radius)
        return Column(params.name, (), x, y, r, low, high, x - r, y - r, x + r, y + r)
    corners = [(float(x), float(y)) for x, y in params.polygon]
    xs, ys = zip(*corners, strict=True)
    box = min(xs), min(ys), max(xs), max(ys)
    return Column(params.name, edges_of(corners), 0.0, 0.0, 0.0, low, high, *box)


def side(zone: Column, x: float | Fraction, y: float | Fraction) -> int:
    """Return whether a point of the plane is inside a zone's outline: 1, on it: 0, or outside: -1."""
    if not zone.edges:
        return _side_of_circle(zone, x, y)
    inside = False
    for ax, ay, bx, by in zone.edges:
        if (ay > y) == (by > y):
            # Both ends are on one side; a point may still be on an end, or on a level edge.
            on = y in {ay, by} and min(ax, bx) <= x <= max(ax, bx)
            if on and turn(ax, ay, bx, by, x, y) == 0 and min(ay, by) <= y <= max(ay, by):
                return 0
            continue
        if ax < x and bx < x:
            continue
        turned = turn(ax, ay, bx, by, x, y)
        if turned == 0:
            return 0
        inside ^= (turned > 0) == (by > ay)
    return 1 if inside else -1


def _side_of_circle(zone: Column, x: float | Fraction, y: float | Fraction) -> int:
    if isinstance(x, float) and isinstance(y, float):
        dx, dy, square = x - zone.x, y - zone.y, zone.radius * zone.radius
        found = dx * dx + dy * dy
        if abs(found - square) > _DOUBT * (found + square):
            return 1 if found < square else -1
    over = _square(Fraction(x) - Fraction(zone.x), Fraction(y) - Fraction(zone.y)) - _square(
        Fraction(zone.radius), Fraction(0)
    )
    return (over < 0) - (over > 0)


def contains(zone: Column, p: Point, *, closed: bool) -> bool:
    """Return whether a point is in a zone, with its boundary or without."""
    x, y, z = p
    if closed:
        return zone.low <= z <= zone.high and side(zone, x, y) >= 0
    return zone.low < z < zone.high and side(zone, x, y) > 0


def crosses(zone: Column, p: Point, q: Point) -> bool:
    """Return whether the straight way from p to q has a point inside a zone; touching is none."""
    px, py, pz = p
    qx, qy, qz = q
    if (
        (px <= zone.west and qx <= zone.west) or (px >= zone.east and qx >= zone.east)
        or (py <= zone.south and qy <= zone.south) or (py >= zone.north and qy >= zone.north)
        or (pz <= zone.low and qz <= zone.low) or (pz >= zone.high and qz >= zone.high)
    ):  # fmt: skip
        return False
    return bool(spans(zone, p, q, closed=False))


def spans(zone: Column, p: Point, q: Point, *, closed: bool = True) -> list[Span]:
    """Return the parts of the straight way from p to q in a zone, with its boundary or without."""
    (px, py, pz), (qx, qy, qz) = p, q
    clip = _clip(zone, pz, qz)
    if clip is None or not (closed or pz != qz or zone.low < pz < zone.high):
        return []
    least = 0 if closed else 1
    if px == qx and py == qy:
        return [clip] if side(zone, px, py) >= least else []
    if zone.edges:
        if not (edges := touched(zone.edges, px, py, qx, qy)):
            return [clip] if side(zone, px, py) >= least else []
        return [(a, b) for a, b, within in _parts(zone, edges, p, q, clip) if within >= least]
    start, way, out = _circle_terms(zone, p, q)
    square = start * start - way * out
    if square < 0:
        return []
    # The root is rounded down: the span ends at most 2^-80 of the way inside the circle.
    root = Fraction(isqrt(square.numerator * _FINE**2 // square.denominator), _FINE)
    a, b = max((-start - root) / way, clip[0]), min((-start + root) / way, clip[1])
    return [(a, b)] if a < b else []


def _square(x: Fraction, y: Fraction) -> Fraction:
    return x * x + y * y


def _circle_terms(zone: Column, p: Point, q: Point) -> tuple[Fraction, Fraction, Fraction]:
    """Return b, a and c: at t, the squared distance less the squared radius is c + 2 b t + a t^2."""
    px, py = Fraction(p[0]), Fraction(p[1])
    dx, dy = Fraction(q[0]) - px, Fraction(q[1]) - py
    ox, oy = px - Fraction(zone.x), py - Fraction(zone.y)
    return ox * dx + oy * dy, _square(dx, dy), _square(ox, oy) - Fraction(zone.radius) ** 2


def _clip(zone: Column, pz: float, qz: float) -> Span | None:
    """Return the part of a way between a zone's floor and ceiling, None for none."""
    if pz == qz:
        return (Fraction(0), Fraction(1)) if zone.low <= pz <= zone.high else None
    start, rise = Fraction(pz), Fraction(qz) - Fraction(pz)
    # A bound beyond both ends takes nothing off; it may be infinite.
    low, high = max(zone.low, min(pz, qz)), min(zone.high, max(pz, qz))
    if low > high:
        return None
    ends = sorted(((Fraction(low) - start) / rise, (Fraction(high) - start) / rise))
    return ends[0], ends[1]


def touched(edges: Sequence[Edge], px: float, py: float, qx: float, qy: float) -> list[Edge]:
    """Return the edges that have a point in common with a way in the plane, or may have."""
    west, east = (px, qx) if px < qx else (qx, px)
    south, north = (py, qy) if py < qy else (qy, py)
    dx, dy = qx - px, qy - py
    found = []
    for edge in edges:
        ax, ay, bx, by = edge
        if (
            (ax < west and bx < west) or (ax > east and bx > east)
            or (ay < south and by < south) or (ay > north and by > north)
        ):  # fmt: skip
            continue
        # Four times the rounding of either product, so that no edge is left out by it.
        a, b = dx * (ay - py), dy * (ax - px)
        c, d = dx * (by - py), dy * (bx - px)
        doubt = 4e-15 * (abs(a) + abs(b) + abs(c) + abs(d))
        one, other = a - b, c - d
        if (one > doubt and other > doubt) or (one < -doubt and other < -doubt):
            continue
        found.append(edge)
    return found


def _parts(
    zone: Column, edges: list[Edge], p: Point, q: Point, clip: Span
) -> Iterator[tuple[Fraction, Fraction, int]]:
    """Yield the parts of a way between its crossings with edges, and the side of each."""
    px, py = Fraction(p[0]), Fraction(p[1])
    dx, dy = Fraction(q[0]) - px, Fraction(q[1]) - py
    way = _square(dx, dy)
    marks = set(clip)
    for edge in edges:
        ax, ay, bx, by = map(Fraction, edge)
        ex, ey, ox, oy = bx - ax, by - ay, ax - px, ay - py
        turned = dx * ey - dy * ex
        if turned != 0:
            if 0 <= (ox * dy - oy * dx) / turned <= 1:
                marks.add((ox * ey - oy * ex) / turned)
        elif ox * dy == oy * dx:
            marks.add((ox * dx + oy * dy) / way)
            marks.add(((bx - px) * dx + (by - py) * dy) / way)
    ordered = sorted(t for t in marks if clip[0] <= t <= clip[1])
    for a, b in pairwise(ordered):
        t = (a + b) / 2
        yield a, b, side(zone, px + t * dx, py + t * dy)


def overlaps(zone: Column, box: Box) -> bool:
    """Return whether a box has a point inside a zone; the box may be flat."""
    (x0, y0, z0), (x1, y1, z1) = box
    if not (
        zone.west < x1 and x0 < zone.east and zone.south < y1 and y0 < zone.north
        and zone.low < z1 and z0 < zone.high
    ):  # fmt: skip
        return False
    if any(crosses(zone, a, b) for a, b in _outline(box, _level(zone, z0, z1))):
        return True
    # Else the zone is wholly in the box, or none of it is.
    return x0 <= zone.west and zone.east <= x1 and y0 <= zone.south and zone.north <= y1


def encloses(zone: Column, box: Box) -> bool:
    """Return whether a zone, with its boundary, has all of a box; the box may be flat."""
    (_, _, z0), (_, _, z1) = box
    # A polygon has no holes: what encloses the outline of the box has its inside, too.
    whole = [(Fraction(0), Fraction(1))]
    return zone.low <= z0 and z1 <= zone.high and all(
        _joined(spans(zone, a, b)) == whole if a != b else contains(zone, a, closed=True)
        for a, b in _outline(box, z0)
    )  # fmt: skip


def _level(zone: Column, z0: float, z1: float) -> float:
    """Return a height (m) inside a zone and between these two, which has to exist."""
    return z0 if zone.low < z0 else z1 if z1 < zone.high else 0.5 * (zone.low + zone.high)


def _outline(box: Box, z: float) -> tuple[tuple[Point, Point], ...]:
    (x0, y0, _), (x1, y1, _) = box
    a, b, c, d = (x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)
    return (a, b), (b, c), (c, d), (d, a)


def _joined(parts: Iterable[Span]) -> list[Span]:
    """Return the union of closed parts of a way."""
    joined: list[Span] = []
    for a, b in sorted(parts):
        if joined and a <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(b, joined[-1][1])
        else:
            joined.append((a, b))
    return joined


def clearance(zone: Column, p: Point) -> float:
    """Return the distance (m) of a point from a zone's boundary, negative inside."""
    x, y, z = p
    if zone.edges:
        across = min(_from_edge(edge, x, y) for edge in zone.edges)
        across = -across if side(zone, x, y) > 0 else across
    else:
        across = hypot(x - zone.x, y - zone.y) - zone.radius
    along = max(zone.low - z, z - zone.high)
    if across <= 0 and along <= 0:
        return max(across, along)
    return hypot(max(across, 0.0), max(along, 0.0))


def _from_edge(edge: Edge, x: float, y: float) -> float:
    ax, ay, bx, by = edge
    ex, ey, ox, oy = bx - ax, by - ay, x - ax, y - ay
    t = min(max((ox * ex + oy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    return hypot(ox - t * ex, oy - t * ey)


def depth(zone: Column, p: Point, q: Point) -> float:
    """Return how deep (m) the straight way from p to q leads into a zone, 0 if it does not.

    It is the depth of its end, or in the middle of each part inside: a thin zone counts although
    the way ends behind it.
    """
    if not crosses(zone, p, q):
        return 0.0
    deepest = clearance(zone, q)
    for a, b in spans(zone, p, q):
        t = float((a + b) / 2)
        middle = tuple(u + t * (v - u) for u, v in zip(p, q, strict=True))
        deepest = min(deepest, clearance(zone, middle))  # type: ignore[arg-type]
    return max(-deepest, 0.0)


class Nearest(NamedTuple):
    """Wall nearest to a vehicle, `cage` for the box, and its distance (m), negative beyond it."""

    name: str
    distance: float


class Region:
    """Space outside every exclusion zone, and inside an inclusion zone if there is any."""

    def __init__(self, zones: Iterable[ZoneParams] = ()) -> None:
        self.exclusions: list[Column] = []
        self.inclusions: list[Column] = []
        for zone in zones:
            kind = self.exclusions if zone.kind == "exclusion" else self.inclusions
            kind.append(zone_of(zone))

    def __bool__(self) -> bool:
        """Return whether there is any zone."""
        return bool(self.exclusions or self.inclusions)

    def why_inside(self, p: Point) -> str:
        """Return which zone bars a point; empty for none."""
        for zone in self.exclusions:
            if contains(zone, p, closed=False):
                return f"inside the zone {zone.name}"
        if self.inclusions and not any(contains(zone, p, closed=True) for zone in self.inclusions):
            return f"outside {self._allowed()}"
        return ""

    def why_crosses(self, p: Point, q: Point) -> str:
        """Return which zone bars the straight way from p to q; empty for none.

        A way that starts inside an exclusion zone may leave it, once.
        """
        for zone in self.exclusions:
            if crosses(zone, p, q) and not _leaves(zone, p, q):
                return f"the way crosses the zone {zone.name}"
        if not self.stays(p, q):
            return f"the way leaves {self._allowed()}"
        return ""

    def stays(self, p: Point, q: Point) -> bool:
        """Return whether a way stays in the inclusion zones, if any, or comes in and stays."""
        if not self.inclusions:
            return True
        if not any(contains(zone, q, closed=True) for zone in self.inclusions):
            return False
        inside = _joined(part for zone in self.inclusions for part in spans(zone, p, q))
        started = any(contains(zone, p, closed=True) for zone in self.inclusions)
        # A way that ends on a boundary, from outside, has no part inside.
        return (
            not started
            if not inside
            else len(inside) == 1 and inside[0][1] == 1 and (inside[0][0] == 0 or not started)
        )

    def why_overlaps(self, box: Box) -> str:
        """Return which zone bars a part of a box; empty for none.

        Of several inclusion zones a single one has to have the whole box.
        """
        for zone in self.exclusions:
            if overlaps(zone, box):
                return f"the way crosses the zone {zone.name}"
        if self.inclusions and not any(encloses(zone, box) for zone in self.inclusions):
            return f"the way leaves {self._allowed()}"
        return ""

    def excess(self, p: Point, q: Point) -> float:
        """Return how far (m) the straight way from p to q leads to where no vehicle may be."""
        far = max((depth(zone, p, q) for zone in self.exclusions), default=0.0)
        if self.inclusions:
            far = max(far, min(max(clearance(zone, q), 0.0) for zone in self.inclusions))
        return far

    def nearest(self, p: Point) -> Nearest | None:
        """Return the nearest boundary of a zone; None without zones."""
        best: Nearest | None = None
        # By a lower bound of the distance: most zones need no look at their corners.
        bounds = [(_at_least(zone, p), number) for number, zone in enumerate(self.exclusions)]
        for least, number in sorted(bounds):
            if best is not None and least >= best.distance:
                break
            zone = self.exclusions[number]
            found = clearance(zone, p)
            if best is None or found < best.distance:
                best = Nearest(zone.name, found)
        if self.inclusions:
            inner = max(
                (Nearest(zone.name, -clearance(zone, p)) for zone in self.inclusions), key=_distance
            )
            if best is None or inner.distance < best.distance:
                best = inner
        return best

    def _allowed(self) -> str:
        names = ", ".join(zone.name for zone in self.inclusions)
        return f"the zone {names}" if len(self.inclusions) == 1 else f"the zones {names}"


def nearest(p: Point, cage: Cage, region: Region) -> Nearest:
    """Return the wall of the cage or of a zone that is nearest to a place; the floor is none."""
    x, y, z = p
    box = Nearest(CAGE_NAME, min(cage.x - abs(x), cage.y - abs(y), cage.z - z))
    zone = region.nearest(p) if region else None
    return zone if zone and zone.distance < box.distance else box


def _distance(nearest: Nearest) -> float:
    return nearest.distance


def _at_least(zone: Column, p: Point) -> float:
    """Return a lower bound (m) of a point's distance from a zone: that from its bounding box."""
    x, y, z = p
    return max(
        zone.west - x, x - zone.east, zone.south - y, y - zone.north, zone.low - z, z - zone.high
    )


def _leaves(zone: Column, p: Point, q: Point) -> bool:
    """Return whether a way that crosses a zone starts inside and then leaves it, never deeper."""
    if not contains(zone, p, closed=False) or contains(zone, q, closed=False):
        return False
    inside = _joined(spans(zone, p, q, closed=False))
    return len(inside) == 1 and inside[0][0] == 0 and not _deepens(zone, p, q, inside[0][1])


_DEEPER = 0.005
"""Metres by which a way out of a zone may lead deeper, unseen or not."""
_MOST_DEPTHS = 400
"""Depths that are compared along a way out; one that needs more is none."""


def _deepens(zone: Column, p: Point, q: Point, end: Fraction) -> bool:
    """Return whether a way from p becomes deeper than there before its part `end` (0 to 1).

    A depth changes by no more than the way does: a part is split until that decides.
    """
    most, metres = -clearance(zone, p) + _DEEPER, dist(p, q)
    parts = [(0.0, float(end))]
    for _ in range(_MOST_DEPTHS):
        if not parts:
            return False
        a, b = parts.pop()
        t = 0.5 * (a + b)
        x, y, z = (u + t * (v - u) for u, v in zip(p, q, strict=True))
        deep = -clearance(zone, (x, y, z))
        if deep > most:
            return True
        if deep + 0.5 * (b - a) * metres > most:
            parts += [(a, t), (t, b)]
    return True
