"""Separation: the space that each vehicle of a run reserves, and which two come too near.

Two vehicles are apart if (dx^2 + dy^2) / across^2 + dz^2 / tall^2 >= 1: an ellipsoid that is taller
than wide, because of the downwash. Distances here are in this measure: 1 is just apart.
"""

from collections.abc import Iterable, Sequence
from enum import Enum
from itertools import pairwise
from math import sqrt
from typing import NamedTuple

from msgspec import Struct

from quadctl.schemas.params import SeparationParams
from quadctl.services.safety.zones import Point

WIDER = 0.02
"""Metres by which ways keep farther away than vehicles must: each of two may stray by 10 mm."""
_ROUNDING = 1e-9
_PARALLEL = 1e-14
"""Square of the sine of an angle below which two lines count as parallel."""


class Piece(NamedTuple):
    """Part of a space, m: a straight line, or all of the box from its lowest to its highest corner."""

    start: Point
    end: Point
    is_box: bool = False


Space = tuple[Piece, ...]


class How(Enum):
    """Why a space is reserved, after the name of its vehicle."""

    IS = "is too near the way"
    ENDS = "flies to a goal too near the way"
    FLIES = "flies too near the way"
    WAITS = "waits to fly there"


class Neighbour(Struct, frozen=True):
    """Another vehicle, and a space that it reserves; it `clears` one that it will leave by itself.

    It has to be `across` (m, horizontal) or `tall` (m, vertical) away.
    """

    name: str
    space: Space
    across: float
    tall: float
    how: How
    clears: bool


def allowed(ours: SeparationParams, theirs: SeparationParams) -> tuple[float, float]:
    """Return how far apart two vehicles have to be, m: across and tall; 0, 0 if one has it off."""
    if not (ours.radius and theirs.radius):
        return 0.0, 0.0
    return ours.radius + theirs.radius, 0.5 * (ours.height + theirs.height)


def conflicts(place: Point, space: Space, others: Iterable[Neighbour]) -> list[Neighbour]:
    """Return the vehicles that a way from a place (m) comes too near, in their order.

    A vehicle that is too near already may leave: its way must not bring it nearer. One inside a space
    in which another moves may not: the other may be anywhere in it.
    """
    here = (Piece(place, place),)
    return [other for other in others if _comes_near(here, space, other)]


def _comes_near(here: Space, space: Space, other: Neighbour) -> bool:
    across, tall = other.across, other.tall
    wide = across + WIDER, tall + WIDER
    if distance(space, other.space, *wide) >= 1:
        return False
    if distance(here, other.space, *wide) >= 1:
        return True
    least = min(distance(here, other.space, across, tall), 1.0)
    if least < _ROUNDING:
        return other.how is not How.IS
    return distance(space, other.space, across, tall) < least - _ROUNDING


def why_near(found: Sequence[Neighbour]) -> str:
    """Return the reason that names the first of the vehicles too near a way; empty without any."""
    return f"separation: {found[0].name} {found[0].how.value}" if found else ""


def distance(space: Space, other: Space, across: float, tall: float) -> float:
    """Return the least distance of two spaces; each needs a piece."""
    ours, theirs = _scaled(space, across, tall), _scaled(other, across, tall)
    return sqrt(min(_square(a, b) for a in ours for b in theirs))


def _scaled(space: Space, across: float, tall: float) -> list[Piece]:
    return [
        Piece((a[0] / across, a[1] / across, a[2] / tall), (b[0] / across, b[1] / across, b[2] / tall), box)
        for a, b, box in space
    ]  # fmt: skip


def _square(a: Piece, b: Piece) -> float:
    """Return the square of two pieces' least distance."""
    if a.is_box and b.is_box:
        gaps = (
            max(low - other_high, other_low - high, 0.0)
            for low, high, other_low, other_high in zip(*a[:2], *b[:2], strict=True)
        )
        return sum(gap * gap for gap in gaps)
    if a.is_box:
        return _from_box(b, a)
    return _from_box(a, b) if b.is_box else _from_line(a, b)


def _from_box(line: Piece, box: Piece) -> float:
    """Return the square of the least distance of a line from a box.

    Along the line the square is a parabola between the points where it passes a plane of the box.
    """
    axes = [(a, b - a, low, high) for a, b, low, high in zip(*line[:2], *box[:2], strict=True)]
    planes = ((bound - a) / way for a, way, *bounds in axes if way for bound in bounds)
    stops = [0.0, *sorted(t for t in planes if 0 < t < 1), 1.0]
    best = _at(axes, 1.0)
    for start, end in pairwise(stops):
        middle = 0.5 * (start + end)
        slope = curve = 0.0
        for a, way, low, high in axes:
            at = a + middle * way
            if not low <= at <= high:
                slope += way * (a - (high if at > high else low))
                curve += way * way
        lowest = min(max(-slope / curve, start), end) if curve else start
        best = min(best, _at(axes, lowest))
    return best


def _at(axes: Sequence[tuple[float, float, float, float]], t: float) -> float:
    square = 0.0
    for a, way, low, high in axes:
        at = a + t * way
        gap = max(low - at, at - high, 0.0)
        square += gap * gap
    return square


def _from_line(a: Piece, b: Piece) -> float:
    """Return the square of the least distance of two lines (Ericson, Real-Time Collision Detection, 5.1.9)."""
    (px, py, pz), (qx, qy, qz), _ = a
    (rx, ry, rz), (sx, sy, sz), _ = b
    ux, uy, uz = qx - px, qy - py, qz - pz
    vx, vy, vz = sx - rx, sy - ry, sz - rz
    wx, wy, wz = px - rx, py - ry, pz - rz
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    uw, vw = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    across = uu * vv - uv * uv
    s = _part(uv * vw - uw * vv, across) if across > _PARALLEL * uu * vv else 0.0
    t = _part(uv * s + vw, vv)
    s = _part(uv * t - uw, uu)
    dx, dy, dz = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return dx * dx + dy * dy + dz * dz


def _part(above: float, below: float) -> float:
    return min(max(above / below, 0.0), 1.0) if below > 0 else 0.0
