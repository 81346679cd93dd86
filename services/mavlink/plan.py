"""Missions and fences as MAVLink transfers them, and as we fly and keep them. Pure."""

from collections.abc import Sequence
from math import isfinite

from msgspec import Struct

from quadctl.schemas.messages import Position, Zone
from quadctl.schemas.zones import FARTHEST, MOST_ZONES, CircleParams, ZoneParams
from quadctl.services.mavlink.geo import Origin
from quadctl.services.runtime.errors import Invalid

WAYPOINT, LOITER_TIME, RETURN, LAND, TAKEOFF, DELAY = 16, 19, 20, 21, 22, 93
_POLYGONS = {5001: "inclusion", 5002: "exclusion"}
_CIRCLES = {5003: "inclusion", 5004: "exclusion"}
_BY_POLYGON = {kind: command for command, kind in _POLYGONS.items()}
_BY_CIRCLE = {kind: command for command, kind in _CIRCLES.items()}
_RELATIVE, _ABSOLUTE = {3, 6}, {0, 5}
"""Frames in which heights are above our origin's ground, or above mean sea level."""
GROUND = 3
MOST_ITEMS = 1000


class Item(Struct, frozen=True):
    """An item of a mission or fence; x and y are 1e-7 degrees, z is m."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


class Step(Struct, frozen=True):
    """A step of a mission: fly to a point (m, ENU), none for the present one, and wait there for s.

    With `lands` the vehicle goes straight down then.
    """

    goal: Position | None
    wait: float = 0.0
    lands: bool = False


def height_of(item: Item, origin: Origin) -> float:
    """Return an item's height (m) above the origin's ground; raise Invalid for another frame."""
    if item.frame in _RELATIVE:
        return item.z
    if item.frame in _ABSOLUTE:
        return item.z - origin.altitude
    raise Invalid(f"frame {item.frame} is not known", "use global frames: 0, 3, 5 or 6")


def steps_of(items: Sequence[Item], origin: Origin, home: Position) -> list[Step]:
    """Return the steps of a mission; raise Invalid for an item that we cannot fly as it says."""
    return [_step(number, item, origin, home) for number, item in enumerate(items)]


def _step(number: int, item: Item, origin: Origin, home: Position) -> Step:
    wait = item.params[0] if item.command in {WAYPOINT, LOITER_TIME, DELAY} else 0.0
    # An item without a delay may have NaN in its place.
    wait = wait if isfinite(wait) and wait > 0 else 0.0
    if item.command == DELAY:
        return Step(None, wait)
    if item.command == RETURN:
        return Step(home, lands=True)
    if item.command not in {WAYPOINT, LOITER_TIME, LAND, TAKEOFF}:
        raise Invalid(
            f"item {number}: command {item.command} cannot be flown",
            "waypoints, takeoff, landing, return, loitering and delays can",
        )
    height = height_of(item, origin)
    if not isfinite(height):
        raise Invalid(f"item {number} has no height")
    if item.command == TAKEOFF and not (item.x or item.y):
        return Step(Position(home.x, home.y, height))
    x, y = origin.to_world(item.x, item.y)
    if item.command == LAND:
        return Step(Position(x, y, max(height, 0.0)), lands=True)
    return Step(Position(x, y, height), wait)


def zones_of(items: Sequence[Item], origin: Origin) -> list[ZoneParams]:
    """Return the zones of a fence; raise Invalid for an item that is no zone."""
    zones: list[ZoneParams] = []
    left = list(items)
    while left:
        first, name = left[0], f"fence {len(zones) + 1}"
        if kind := _POLYGONS.get(first.command):
            count = round(first.params[0])
            corners, left = left[:count], left[count:]
            alike = (first.command, first.params[0])
            if len(corners) != count or {(c.command, c.params[0]) for c in corners} != {alike}:
                raise Invalid(f"{name}: a polygon of {count} corners has {len(corners)}")
            polygon = tuple(origin.to_world(corner.x, corner.y) for corner in corners)
            zones.append(_zone(name, kind, polygon=polygon))
        elif kind := _CIRCLES.get(first.command):
            left = left[1:]
            circle = CircleParams(*origin.to_world(first.x, first.y), first.params[0])
            zones.append(_zone(name, kind, circle=circle))
        else:
            raise Invalid(f"{name}: command {first.command} is no zone", "polygons and circles are")
    if len(zones) > MOST_ZONES:
        raise Invalid(f"{len(zones)} zones: at most {MOST_ZONES} are allowed")
    return zones


def _zone(name: str, kind: str, **shape: object) -> ZoneParams:
    try:
        return ZoneParams(name, kind, **shape)  # type: ignore[arg-type]
    except ValueError as error:
        raise Invalid(str(error)) from error


def items_of(zones: Sequence[Zone], origin: Origin) -> list[Item]:
    """Return the items of zones; raise Invalid for one with a floor or a ceiling, which MAVLink lacks."""
    items: list[Item] = []
    for zone in zones:
        if zone.floor > -FARTHEST or zone.ceiling < FARTHEST:
            raise Invalid(f"zone {zone.name} has a floor or a ceiling, which a fence has not")
        if zone.corners:
            command, count = _BY_POLYGON[zone.kind], float(len(zone.corners))
            for corner in zone.corners:
                x, y = origin.to_earth(corner.x, corner.y)
                items.append(Item(GROUND, command, (count, 0.0, 0.0, 0.0), x, y, 0.0))
        else:
            x, y = origin.to_earth(zone.circle.x, zone.circle.y)
            params = (zone.circle.radius, 0.0, 0.0, 0.0)
            items.append(Item(GROUND, _BY_CIRCLE[zone.kind], params, x, y, 0.0))
    return items
