"""Picture of fifty vehicles that change places, flown by the plan of `fleet goto`."""

import math

from quadctl.cli.fleet.plan import Space as Airspace, plan
from quadctl.schemas.messages import Position
from quadctl.services.airspace.geometry import Point
from tests.support.fleet_flights import ACROSS, TALL, FleetFlight, fly_plan

_COUNT, _COLUMNS, _GAP, _CAGE = 50, 10, 0.8, 5.0
"""Vehicles, vehicles in a row, metres between them, and the cage's bound, m."""
_SCALE, _EDGE, _TITLE = 46, 12, 20
"""Pixels for a metre, around a view, and for its title."""
_BENDS = 0.02
"""Metres off a straight line at which a path gets a point."""


def places() -> list[Point]:
    """Return the places of a grid at a height of 1 m; each vehicle goes to the one opposite."""
    rows = _COUNT // _COLUMNS
    return [
        (_GAP * (n % _COLUMNS - (_COLUMNS - 1) / 2), _GAP * (n // _COLUMNS - (rows - 1) / 2), 1.0)
        for n in range(_COUNT)
    ]


def flown() -> tuple[FleetFlight, list[list[Point]]]:
    """Fly the real vehicles by a plan, and return their paths."""
    starts = places()
    flight = FleetFlight(*(Position(*place) for place in starts), size=_CAGE, height=_CAGE)
    paths: list[list[Point]] = [[] for _ in starts]

    def look() -> None:
        if round(flight.members[0].vehicle.time * 20) % 5:
            return  # four points in a second are enough
        for path, member in zip(paths, flight.members, strict=True):
            path.append(member.vehicle.position)

    ends = {f"uav{n}": place for n, place in enumerate(reversed(starts))}
    space = Airspace(ACROSS, TALL, (-_CAGE, -_CAGE, 0.0), (_CAGE, _CAGE, _CAGE), lambda *_: True)
    legs = plan({f"uav{n}": place for n, place in enumerate(starts)}, ends, space)
    fly_plan(flight, legs, look)
    return flight, paths


def picture(flight: FleetFlight, paths: list[list[Point]]) -> str:
    """Return the paths from above and from the side as SVG."""
    seconds = flight.members[0].vehicle.time
    title = f"{_COUNT} vehicles change places in {seconds:.0f} s, seen from above"
    least = f"from the side; least distance {flight.nearest:.2f} of what they keep"
    size = 2 * _CAGE * _SCALE
    width, height = size + 2 * _EDGE, size + _CAGE * _SCALE + 2 * _TITLE + 3 * _EDGE
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif" font-size="13">',
        f"<title>{title}</title>", f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>',
    ]  # fmt: skip
    for name, up, top, low, high in (
        (title, 1, _TITLE, -_CAGE, _CAGE),
        (least, 2, size + 2 * _TITLE + _EDGE, 0.0, _CAGE),
    ):
        tall = (high - low) * _SCALE
        parts.append(f'<text x="{_EDGE}" y="{top - 5:.0f}">{name}</text>')
        parts.append(
            f'<rect x="{_EDGE}" y="{top:.0f}" width="{size:.0f}" height="{tall:.0f}" fill="none" stroke="#1a7f37" stroke-dasharray="6 4"/>'
        )
        for number, path in enumerate(paths):
            points = [
                (_EDGE + (p[0] + _CAGE) * _SCALE, top + (high - p[up]) * _SCALE)
                for p in _bends(path)
            ]
            text = " ".join(f"{x:.0f},{y:.0f}" for x, y in points)
            colour = f"hsl({number * 360 // _COUNT} 70% 42%)"
            parts.append(
                f'<polyline points="{text}" fill="none" stroke="{colour}" stroke-opacity="0.7"/>'
            )
            (x, y), (u, v) = points[0], points[-1]
            parts.append(f'<circle cx="{x:.0f}" cy="{y:.0f}" r="3" fill="none" stroke="{colour}"/>')
            parts.append(f'<circle cx="{u:.0f}" cy="{v:.0f}" r="3" fill="{colour}"/>')
    return "\n".join([*parts, "</svg>", ""])


def _bends(path: list[Point]) -> list[Point]:
    """Return a path without the points that are on the straight line between others."""
    kept = [path[0]]
    start = 0
    for end in range(2, len(path)):
        a, b = path[start], path[end]
        if any(_off(p, a, b) > _BENDS for p in path[start + 1 : end]):
            start = end - 1
            kept.append(path[start])
    return [*kept, path[-1]]


def _off(p: Point, a: Point, b: Point) -> float:
    way = [v - u for u, v in zip(a, b, strict=True)]
    to = [v - u for u, v in zip(a, p, strict=True)]
    length = sum(d * d for d in way)
    t = (
        min(max(sum(d * e for d, e in zip(way, to, strict=True)) / length, 0.0), 1.0)
        if length
        else 0.0
    )
    return math.hypot(*(e - t * d for d, e in zip(way, to, strict=True)))
