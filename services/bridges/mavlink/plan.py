"""Missions and fences as MAVLink transfers them, and as we fly and keep them. Pure."""

from collections.abc import Sequence
from math import inf, isfinite, isnan

from msgspec import Struct
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import Origin
from quadctl.schemas.zones import FARTHEST, MOST_ZONES, CircleParams, ZoneParams
from quadctl.services.runtime.errors import Invalid

_SHAPES = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: ("inclusion", "polygon"),
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: ("exclusion", "polygon"),
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: ("inclusion", "circle"),
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: ("exclusion", "circle"),
}
_COMMANDS = {shape: command for command, shape in _SHAPES.items()}
_ABSOLUTE = {mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT}
_RELATIVE = {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
"""Frames with heights above mean sea level, and above our origin's ground."""
_GROUND = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
NOWHERE = 2**31 - 1
"""Latitude or longitude of an item that has none."""
_FARTHEST_NORTH, _FARTHEST_EAST = 900_000_000, 1_800_000_000
MOST_ITEMS = 1000
_MOST_DEGREES = 180.0


def degrees_e7(degrees: float) -> int:
    """Return degrees as 1e-7 degrees; NOWHERE for NaN, and for what is no place on the earth."""
    return round(degrees * 1e7) if abs(degrees) <= _MOST_DEGREES else NOWHERE


class PlanItem(Struct, frozen=True):
    """Item of a mission or fence, or a command; x and y are 1e-7 degrees, z is m."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int = NOWHERE
    y: int = NOWHERE
    z: float = float("nan")
    goes_on: bool = True

    @property
    def has_place(self) -> bool:
        """Return whether the item has latitude and longitude; zeros stand for none, too."""
        return NOWHERE not in {self.x, self.y} and (self.x, self.y) != (0, 0)


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
    """Return the step to an item's point; raise Invalid for an unknown frame, or no place on earth."""
    x, y = _place(item, origin)
    z = item.z - origin.altitude if item.frame in _ABSOLUTE else item.z
    return MissionStep(
        None if item.x == NOWHERE else x,
        None if item.y == NOWHERE else y,
        z if isfinite(z) else None,
        wait,
    )


def _place(item: PlanItem, origin: Origin) -> tuple[float, float]:
    """Return an item's place (m, ENU); raise Invalid for an unknown frame, or no place on earth."""
    if item.frame not in _ABSOLUTE | _RELATIVE:
        raise Invalid(f"frame {item.frame} is not known", "use global frames: 0, 3, 5 or 6")
    if (item.x != NOWHERE and abs(item.x) > _FARTHEST_NORTH) or (
        item.y != NOWHERE and abs(item.y) > _FARTHEST_EAST
    ):
        raise Invalid(f"({item.x / 1e7:g}, {item.y / 1e7:g}) is no place on the earth")
    return origin.to_world(item.x, item.y)


def check_speed(speed: float, flyer: Flyer) -> None:
    """Raise Invalid for a smaller speed (m/s) than the vehicle's; a negative one stands for any."""
    if 0 <= speed < flyer.top_speed:
        raise Invalid(
            f"the vehicle flies at {flyer.top_speed:g} m/s, not at {speed:g}",
            "dynamics.control.max_speed is its speed",
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
    if not item.goes_on:
        raise Invalid("a mission that does not go on by itself cannot be flown")
    match item.command:
        case mavlink.MAV_CMD_NAV_WAYPOINT | mavlink.MAV_CMD_NAV_LOITER_TIME:
            return point_of(item, origin, wait=_delay(first))
        case mavlink.MAV_CMD_NAV_LOITER_UNLIM if is_last:
            return point_of(item, origin)
        case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return MissionStep(*flyer.start, lands=True)
        case mavlink.MAV_CMD_NAV_LAND:
            x, y = _place(item, origin) if item.has_place else (None, None)
            return MissionStep(x, y, lands=True)
        case mavlink.MAV_CMD_NAV_TAKEOFF:
            return takeoff_of(item, origin)
        case mavlink.MAV_CMD_NAV_DELAY if first > 0:
            return MissionStep(wait=_delay(first))
        case mavlink.MAV_CMD_DO_CHANGE_SPEED:
            check_speed(second, flyer)
            return MissionStep()
    raise Invalid(
        f"command {item.command} cannot be flown",
        "waypoints, takeoff, landing, return, loitering and delays can",
    )


def takeoff_of(item: PlanItem, origin: Origin) -> MissionStep:
    """Return the step of a takeoff: to an item's height, and place if it has one."""
    point = point_of(item, origin)
    return point if item.has_place else MissionStep(z=point.z)


def _delay(seconds: float) -> float:
    """Return a delay, s; an item without one may have NaN in its place."""
    if isnan(seconds):
        return 0.0
    if not 0 <= seconds < inf:
        raise Invalid(f"a delay of {seconds:g} s")
    return seconds


def zones_of(items: Sequence[PlanItem], origin: Origin) -> list[ZoneParams]:
    """Return the zones of a fence; raise Invalid for an item that is no zone.

    MAVLink wants a vehicle to be inside all inclusion zones of one of their groups, we in any one of
    them: this is the same only if each has a group of its own.
    """
    zones: list[ZoneParams] = []
    groups: set[float] = set()
    left = list(items)
    while left:
        first, name = left[0], f"fence {len(zones) + 1}"
        size, group, *_ = first.params
        corners = [first]
        kind, shape = _SHAPES.get(first.command, ("", ""))
        if shape == "polygon":
            if size in range(3, len(left) + 1):
                corners = left[: int(size)]
            if {(c.command, *c.params[:2]) for c in corners} != {(first.command, size, group)}:
                raise Invalid(f"{name}: its corners are of several polygons")
            if len(corners) != size:
                raise Invalid(f"{name}: a polygon has not the {size:g} corners that it announces")
        elif not shape:
            raise Invalid(f"{name}: command {first.command} is no zone", "polygons and circles are")
        if not all(corner.has_place for corner in corners):
            raise Invalid(f"{name}: a point has no place")
        if kind == "inclusion":
            if group in groups:
                raise Invalid(f"{name}: two inclusion zones have the group {group:g}")
            groups.add(group)
        left = left[len(corners) :]
        places = tuple(_place(corner, origin) for corner in corners)
        what = places if shape == "polygon" else _circle(name, places[0], size)
        try:
            zones.append(ZoneParams(name, kind, **{shape: what}))  # type: ignore[arg-type]
        except ValueError as error:
            raise Invalid(str(error)) from error
    if len(zones) > MOST_ZONES:
        raise Invalid(f"{len(zones)} zones: at most {MOST_ZONES} are allowed")
    return zones


def _circle(name: str, place: tuple[float, float], radius: float) -> CircleParams:
    if not 0 < radius < inf:
        raise Invalid(f"{name}: a circle of radius {radius:g} m", "give it a radius above 0")
    return CircleParams(*place, radius)


def items_of(zones: Sequence[ZoneParams], origin: Origin) -> list[PlanItem]:
    """Return the items of zones; raise Invalid for one with a floor or a ceiling, which MAVLink lacks."""
    items: list[PlanItem] = []
    for group, zone in enumerate(zones):
        if zone.floor > -FARTHEST or zone.ceiling < FARTHEST:
            raise Invalid(f"zone {zone.name} has a floor or a ceiling, which a fence has not")
        shape, size = "circle", zone.circle.radius
        if zone.polygon:
            shape, size = "polygon", float(len(zone.polygon))
        command = _COMMANDS[zone.kind, shape]
        for place in zone.polygon or ((zone.circle.x, zone.circle.y),):
            x, y = origin.to_earth(*place)
            items.append(PlanItem(_GROUND, command, (size, float(group), 0.0, 0.0), x, y, 0.0))
    return items
