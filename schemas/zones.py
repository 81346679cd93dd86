"""Zones: columns of space that a vehicle must not enter, or must not leave.

A polygon has to be simple, because only then has every point an inside and an outside. The decision
is exact: floating point first, rational numbers where its rounding could matter.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta, Struct

from quadctl.schemas.units import Metres, described

if TYPE_CHECKING:
    from fractions import Fraction

Corner = tuple[Metres, Metres]
ZoneKind = Literal["exclusion", "inclusion"]
Edge = tuple[float, float, float, float]
"""Both ends of a straight line: x, y, x, y, m."""

FARTHEST = 10_000.0
"""Height (m) beyond which nothing is: a bound there is none."""
CAGE_NAME = "cage"
"""Name of the box among the walls, so no zone may have it."""
MOST_CORNERS, MOST_ZONES = 64, 50
_OTHERS = str.maketrans(dict.fromkeys("_ .-", "a"))
"""Other characters of a name, each taken for a letter."""

_ROUNDING = 1e-15
"""More than the relative rounding of a 2 x 2 determinant of differences (Shewchuk: 3.4e-16)."""


class CircleParams(Struct, forbid_unknown_fields=True, frozen=True):
    """Circle, m, ENU; one without a radius is none."""

    x: Metres = 0.0
    y: Metres = 0.0
    radius: Annotated[float, Meta(ge=0, le=10_000)] = 0.0


class ZoneParams(Struct, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """Column over a polygon or a circle, from `floor` to `ceiling`."""

    name: Annotated[str, described("name in messages and commands")]
    kind: Annotated[
        ZoneKind,
        described("exclusion: the vehicle stays out; inclusion: it stays in one of these"),
    ] = "exclusion"
    polygon: Annotated[
        tuple[Corner, ...], described("corners, 3 to 64, either way round, not crossing", "m")
    ] = ()
    circle: Annotated[CircleParams, described("centre and radius, without a polygon", "m")] = (
        CircleParams()
    )
    floor: Annotated[Metres, described("lower bound; none by default", "m")] = -FARTHEST
    ceiling: Annotated[Metres, described("upper bound; none by default", "m")] = FARTHEST

    def __post_init__(self) -> None:
        """Raise ValueError for a zone without a clear inside."""
        letters = self.name.translate(_OTHERS)
        if not (0 < len(self.name) <= 64 and letters.isascii() and letters.isalnum()):
            raise ValueError(
                f"zone {self.name!r}: a name has 1 to 64 letters, digits, blanks, '_', '.' and '-'"
            )
        if self.name == CAGE_NAME:
            raise ValueError(f"zone {self.name}: this name means the box; take another one")
        if why := self._why_unclear():
            raise ValueError(f"zone {self.name}: {why}")

    def _why_unclear(self) -> str:
        if bool(self.polygon) == bool(self.circle.radius):
            return "it needs either a polygon or a circle"
        if self.floor >= self.ceiling:
            return f"floor {self.floor:g} is not below ceiling {self.ceiling:g}"
        return why_not_simple(self.polygon) if self.polygon else ""


def check_zones(zones: Sequence[ZoneParams]) -> None:
    """Raise ValueError for too many zones or two of one name."""
    if len(zones) > MOST_ZONES:
        raise ValueError(f"{len(zones)} zones: at most {MOST_ZONES} are allowed")
    seen: set[str] = set()
    for zone in zones:
        if zone.name in seen:
            raise ValueError(f"two zones have the name {zone.name}")
        seen.add(zone.name)


def turn(
    ax: float, ay: float, bx: float, by: float, cx: "float | Fraction", cy: "float | Fraction"
) -> int:
    """Return the side of c seen from a to b: 1 left, -1 right, 0 on the line; exact."""
    if isinstance(cx, float) and isinstance(cy, float):
        left, right = (bx - ax) * (cy - ay), (by - ay) * (cx - ax)
        det = left - right
        bound = _ROUNDING * (abs(left) + abs(right))
        if det > bound:
            return 1
        if -det > bound:
            return -1
    from fractions import Fraction  # with re and decimal, it takes a command 10 ms

    fax, fay = Fraction(ax), Fraction(ay)
    exact = (Fraction(bx) - fax) * (Fraction(cy) - fay) - (Fraction(by) - fay) * (
        Fraction(cx) - fax
    )
    return (exact > 0) - (exact < 0)


def edges_of(corners: Sequence[tuple[float, float]]) -> tuple[Edge, ...]:
    """Return the edges of a polygon, in order."""
    ends = (*corners[1:], corners[0])
    return tuple((*a, *b) for a, b in zip(corners, ends, strict=True))


def why_not_simple(corners: Sequence[tuple[float, float]]) -> str:
    """Return why a polygon is not simple: too few corners, or edges that touch; else empty."""
    if not 3 <= len(corners) <= MOST_CORNERS:
        return f"{len(corners)} corners: a polygon has 3 to {MOST_CORNERS}"
    edges = edges_of(corners)
    for n, (ax, ay, bx, by) in enumerate(edges):
        if ax == bx and ay == by:
            return f"corners {n + 1} and {(n + 1) % len(edges) + 1} are the same point"
    for n, (ax, ay, bx, by) in enumerate(edges):
        cx, cy = edges[(n + 1) % len(edges)][2:]
        # The next edge may not come back on this one.
        if turn(ax, ay, bx, by, cx, cy) == 0 and (bx - ax) * (cx - bx) + (by - ay) * (cy - by) <= 0:
            return f"the edges at corner {(n + 1) % len(edges) + 1} lie on each other"
        low_x, high_x = (ax, bx) if ax < bx else (bx, ax)
        low_y, high_y = (ay, by) if ay < by else (by, ay)
        last = len(edges) - 1 if n == 0 else len(edges)
        for m in range(n + 2, last):
            ux, uy, vx, vy = edges[m]
            if (
                (ux < low_x and vx < low_x) or (ux > high_x and vx > high_x)
                or (uy < low_y and vy < low_y) or (uy > high_y and vy > high_y)
            ):  # fmt: skip
                continue
            if _meet(edges[n], edges[m]):
                return f"the edges after corners {n + 1} and {m + 1} cross or touch"
    return ""


def _meet(one: Edge, other: Edge) -> bool:
    """Return whether two edges with overlapping bounding boxes have a point in common."""
    a, b, c, d = one[:2], one[2:], other[:2], other[2:]
    return turn(*a, *b, *c) * turn(*a, *b, *d) <= 0 and turn(*c, *d, *a) * turn(*c, *d, *b) <= 0
