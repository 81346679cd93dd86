"""Decisions about zones beside shapely's, which decides by the same floating-point corners."""

import math
import random
from collections.abc import Iterator

import shapely
from shapely.geometry import LineString, Point as Place, Polygon

from quadctl.schemas.zones import ZoneParams, why_not_simple
from quadctl.services.airspace.zones import (
    clearance,
    crosses,
    encloses,
    overlaps,
    side,
    spans,
    zone_of,
)

NEAR = 1e-9
"""Distance (m) from a boundary within which shapely's decision may be rounded."""
Corner = tuple[float, float]


def decisions(corners: list[Corner], p: Corner, q: Corner) -> Iterator[tuple[str, bool]]:
    """Yield each decision about a place, a way and a box, and whether shapely agrees."""
    zone, polygon = zone_of(ZoneParams("a", polygon=tuple(corners))), Polygon(corners)
    edge = polygon.exterior.distance(Place(p))
    found = side(zone, *p)
    yield "side", edge <= NEAR or found == (1 if polygon.contains(Place(p)) else -1)
    yield "clearance", abs(clearance(zone, (*p, 0.0)) - (-edge if found > 0 else edge)) < NEAR
    a, b = (*p, 1.0), (*q, 1.0)
    if p != q:
        line, crossed = LineString([p, q]), crosses(zone, a, b)
        if crossed:
            yield "crosses", line.intersection(polygon.buffer(NEAR)).length > 0
        else:
            yield "crosses", line.intersection(polygon.buffer(-NEAR)).length <= NEAR
        yield "crosses back", crosses(zone, b, a) is crossed
        within = sum(float(end - start) for start, end in spans(zone, a, b)) * line.length
        # Along a side, either length is right.
        tight = line.intersection(polygon.buffer(-NEAR)).length
        wide = line.intersection(polygon.buffer(NEAR)).length
        yield "spans", tight - 1e-6 <= within <= wide + 1e-6
    (x0, x1), (y0, y1) = sorted((p[0], q[0])), sorted((p[1], q[1]))
    if x0 < x1 and y0 < y1:
        low, high, box = (x0, y0, 1.0), (x1, y1, 1.0), shapely.box(x0, y0, x1, y1)
        area = box.intersection(polygon).area
        yield "overlaps", overlaps(zone, (low, high)) is (area > 0) or area < NEAR
        covers = encloses(zone, (low, high)) is polygon.covers(box)
        yield "encloses", covers or polygon.exterior.distance(box) < NEAR


def around(corners: list[Corner], x: float, y: float) -> list[Corner]:
    """Return corners in their order around a point, which often makes a concave polygon."""
    return sorted(corners, key=lambda c: math.atan2(c[1] - y, c[0] - x))


def compare(count: int, seed: int) -> tuple[int, list[str]]:
    """Make so many random decisions; return their number and the ones that shapely does not share."""
    draws, made, odd = random.Random(seed), 0, []
    while made < count:
        on_grid = draws.random() < 0.5

        def point(on_grid: bool = on_grid) -> Corner:
            x, y = draws.uniform(-4, 4), draws.uniform(-4, 4)
            return (float(round(x)), float(round(y))) if on_grid else (x, y)

        corners = around(list({point() for _ in range(draws.randint(3, 12))}), *point())
        if why_not_simple(corners):
            continue
        for _ in range(20):
            p, q = point(), point()
            for name, agrees in decisions(corners, p, q):
                made += 1
                if not agrees:
                    odd.append(f"{name}: {corners} {p} {q}")
    return made, odd
