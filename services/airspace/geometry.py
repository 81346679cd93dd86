"""Geometry of places, straight lines and boxes, and how far these are from each other; m, ENU."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import sqrt
from typing import NamedTuple

from msgspec.structs import astuple

from quadctl.schemas.messages import Pose

Point = tuple[float, float, float]
"""East, north and up."""
Box = tuple[Point, Point]
"""Lowest and highest corner."""

_PARALLEL = 1e-14
"""Square of the sine of an angle below which two lines count as parallel."""


class Piece(NamedTuple):
    """Part of a space: a straight line, or all of the box from its lowest to its highest corner."""

    start: Point
    end: Point
    is_box: bool = False


Space = tuple[Piece, ...]


def place_of(pose: Pose) -> Point:
    """Return where a vehicle is."""
    return astuple(pose.position)


def velocity_of(pose: Pose) -> Point:
    """Return how a vehicle moves, m/s."""
    return astuple(pose.velocity)


def around(*points: Point) -> Box:
    """Return the smallest box with all points."""
    (x0, *_, x1), (y0, *_, y1), (z0, *_, z1) = map(sorted, zip(*points, strict=True))
    return (x0, y0, z0), (x1, y1, z1)


def distance(space: Space, other: Space, across: float, tall: float) -> float:
    """Return the least distance of two spaces, measured in `across` (horizontal) and `tall` (vertical).

    Each space needs a piece.
    """
    ours, theirs = _scaled(space, across, tall), _scaled(other, across, tall)
    return sqrt(min(_square(a, b) for a in ours for b in theirs))


def away(place: Point, space: Iterable[Piece]) -> float:
    """Return the least distance (m) of a place from a space."""
    return sqrt(min([_from_place(place, piece) for piece in space]))


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


def _from_place(place: Point, piece: Piece) -> float:
    """Return the square of the least distance of a place from a piece."""
    (x, y, z), ((ax, ay, az), (bx, by, bz), is_box) = place, piece
    if is_box:
        dx, dy, dz = max(ax - x, x - bx, 0.0), max(ay - y, y - by, 0.0), max(az - z, z - bz, 0.0)
        return dx * dx + dy * dy + dz * dz
    ux, uy, uz, dx, dy, dz = bx - ax, by - ay, bz - az, x - ax, y - ay, z - az
    t = _part(ux * dx + uy * dy + uz * dz, ux * ux + uy * uy + uz * uz)
    dx, dy, dz = dx - t * ux, dy - t * uy, dz - t * uz
    return dx * dx + dy * dy + dz * dz


def _part(above: float, below: float) -> float:
    return min(max(above / below, 0.0), 1.0) if below > 0 else 0.0
