"""Missions and fences as MAVLink transfers them, and as we fly and keep them. Pure."""

from collections.abc import Sequence
from math import isfinite

from msgspec import Struct
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.messages import Zone
from quadctl.schemas.zones import FARTHEST, MOST_ZONES, CircleParams, ZoneParams
from quadctl.services.mavlink.geo import Origin
from quadctl.services.runtime.errors import Invalid

_POLYGONS = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: "inclusion",
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: "exclusion",
}
_CIRCLES = {
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: "inclusion",
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: "exclusion",
}
_BY_POLYGON = {kind: command for command, kind in _POLYGONS.items()}
_BY_CIRCLE = {kind: command for command, kind in _CIRCLES.items()}
_ABSOLUTE = {mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT}
_RELATIVE = {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
"""Frames with heights above mean sea level, and above our origin's ground."""
_GROUND = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
NOWHERE = 2**31 - 1
"""Latitude or longitude of an item that has none."""
MOST_ITEMS = 1000


class PlanItem(Struct, frozen=True):
    """Item of a mission or fence, or a command; x and y are 1e-7 degrees, z is m."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int = NOWHERE
    y: int = NOWHERE
    z: float = float("nan")


class MissionStep(Struct, frozen=True):
    """Step of a mission: a flight to a point (m, ENU), then a wait, s.

    None is the vehicle's present coordinate. With `lands` the vehicle goes straight down at the end.
    """

    x: float | None = None
    y: float | None = None
    z: float | None = None
    wait: float = 0.0
    lands: bool = False

    @property
    def flies(self) -> bool:
        """Return whether the step has a point to fly to."""
        return (self.x, self.y, self.z) != (None, None, None)


class Flyer(Struct, frozen=True):
    """Facts of a vehicle that its missions need: its start (m) and its top speed, m/s."""

    start: tuple[float, float]
    top_speed: float


def point_of(item: PlanItem, origin: Origin, *, wait: float = 0.0) -> MissionStep:
    """Return the step to an item's point; raise Invalid for an unknown frame."""
    x, y = origin.to_world(item.x, item.y)
    if item.frame not in _ABSOLUTE | _RELATIVE:
        raise Invalid(f"frame {item.frame} is not known", "use global frames: 0, 3, 5 or 6")
    z = item.z - origin.altitude if item.frame in _ABSOLUTE else item.z
    return MissionStep(
        None if item.x == NOWHERE else x,
        None if item.y == NOWHERE else y,
        z if isfinite(z) else None,
        wait,
    )


def steps_of(items: Sequence[PlanItem], origin: Origin, flyer: Flyer) -> list[MissionStep]:
    """Return the steps of a mission; raise Invalid for an item that we cannot fly as declared."""
    steps = []
    for number, item in enumerate(items):
        try:
            steps.append(_step(item, origin, flyer, is_last=number + 1 == len(items)))
        except Invalid as problem:
            raise Invalid(f"item {number}: {problem.message}", problem.hint) from problem
    return steps


def _step(item: PlanItem, origin: Origin, flyer: Flyer, *, is_last: bool) -> MissionStep:
    first, second, *_ = item.params
    # An item without a delay may have NaN in its place.
    wait = first if isfinite(first) and first > 0 else 0.0
    match item.command:
        case mavlink.MAV_CMD_NAV_WAYPOINT | mavlink.MAV_CMD_NAV_LOITER_TIME:
            return point_of(item, origin, wait=wait)
        case mavlink.MAV_CMD_NAV_LOITER_UNLIM if is_last:
            return point_of(item, origin)
        case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return MissionStep(*flyer.start, lands=True)
        case mavlink.MAV_CMD_NAV_LAND:
            x, y = origin.to_world(item.x, item.y) if item.x or item.y else (None, None)
            return MissionStep(x, y, lands=True)
        case mavlink.MAV_CMD_NAV_TAKEOFF:
            point = point_of(item, origin)
            if item.x or item.y:
                return point
            return MissionStep(z=point.z)
        case mavlink.MAV_CMD_NAV_DELAY if wait:
            return MissionStep(wait=wait)
        case mavlink.MAV_CMD_DO_CHANGE_SPEED if not 0 <= second < flyer.top_speed:
            return MissionStep()
        case mavlink.MAV_CMD_DO_CHANGE_SPEED:
            raise Invalid(
                f"the vehicle flies at {flyer.top_speed:g} m/s, not at {second:g}",
                "dynamics.control.max_speed is its speed",
            )
    raise Invalid(
        f"command {item.command} cannot be flown",
        "waypoints, takeoff, landing, return, loitering and delays can",
    )


def zones_of(items: Sequence[PlanItem], origin: Origin) -> list[ZoneParams]:
    """Return the zones of a fence; raise Invalid for an item that is no zone."""
    zones: list[ZoneParams] = []
    left = list(items)
    while left:
        first, name = left[0], f"fence {len(zones) + 1}"
        if kind := _POLYGONS.get(first.command):
            count, corners = first.params[0], []
            if count in range(3, len(left) + 1):
                corners, left = left[: int(count)], left[int(count) :]
            if not corners or {(c.command, c.params[0]) for c in corners} != {
                (first.command, count)
            }:
                raise Invalid(f"{name}: a polygon has not the {count:g} corners that it announces")
            polygon = tuple(origin.to_world(corner.x, corner.y) for corner in corners)
            zones.append(_zone(name, kind, polygon=polygon))
        elif kind := _CIRCLES.get(first.command):
            left = left[1:]
            centre = origin.to_world(first.x, first.y)
            zones.append(_zone(name, kind, circle=CircleParams(*centre, first.params[0])))
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


def items_of(zones: Sequence[Zone], origin: Origin) -> list[PlanItem]:
    """Return the items of zones; raise Invalid for one with a floor or a ceiling, which MAVLink lacks."""
    items: list[PlanItem] = []
    for zone in zones:
        if zone.floor > -FARTHEST or zone.ceiling < FARTHEST:
            raise Invalid(f"zone {zone.name} has a floor or a ceiling, which a fence has not")
        command, number = _BY_CIRCLE[zone.kind], zone.circle.radius
        if zone.corners:
            command, number = _BY_POLYGON[zone.kind], float(len(zone.corners))
        for place in zone.corners or (zone.circle,):
            x, y = origin.to_earth(place.x, place.y)
            items.append(PlanItem(_GROUND, command, (number, 0.0, 0.0, 0.0), x, y, 0.0))
    return items
