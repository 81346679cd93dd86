"""Fleet file: vehicles by name, the hub of each, and formations.

[vehicles]
uav0 = {}                                              # on this realm's hub, or --connect's
red = { connect = "tls/lab2:7447", vehicle = "uav" }   # on its own hub, where its name is uav

[formations.line]                                      # m, about the X Y Z of `fleet goto`
uav0 = [-1.0, 0.0, 0.0]
red = [1.0, 0.0, 0.0]
"""

from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from quadctl.schemas.messages import Position
from quadctl.schemas.typed import converted
from quadctl.schemas.units import Metres
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.params import catalogue, load
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.realm import vehicle_name
from quadctl.services.runtime.security import endpoints

DEFAULT = Path("fleet.toml")
_EXAMPLE = 'a vehicle is written as uav0 = {} or uav0 = { connect = "tls/host:7447" }'
_POINT = "a place is written as uav0 = [1.0, 2.0, 0.5], metres, none above 10000"
_WRITTEN = "write [vehicles] and below it a line `uav0 = {}` for each, as examples/fleet.toml does"

T = TypeVar("T")


class Member(Struct, frozen=True):
    """Vehicle of a fleet: its hub's endpoint, empty for the realm's own, and its name there."""

    name: str
    connect: str
    vehicle: str


class FleetFile(Struct, frozen=True):
    """Vehicles, and their places (m) in each formation, as read from the file `source`."""

    members: list[Member]
    formations: dict[str, dict[str, Position]]
    source: str = ""


class _Entry(Struct, frozen=True, forbid_unknown_fields=True):
    connect: str = ""
    vehicle: str = ""


class _Tables(Struct, frozen=True, forbid_unknown_fields=True):
    vehicles: dict[str, Any]
    formations: dict[str, dict[str, Any]] = {}


def read(file: Path, connect: str) -> FleetFile:
    """Read a fleet file; `connect` is the endpoint of those that name none. Raises Invalid."""
    return fleet_of(load.read(file, _WRITTEN), str(file), connect)


def fleet_of(table: dict[str, Any], source: str, connect: str) -> FleetFile:
    """Return the fleet in the tables of a file; see `read`."""
    tables = _checked(table, _Tables, source, "the tables are [vehicles] and [formations.NAME]")
    members = [_member(name, value, source, connect) for name, value in tables.vehicles.items()]
    if not members:
        raise Invalid(f"{source}: it names no vehicle", _EXAMPLE)
    _check_distinct(members, source)
    names = [member.name for member in members]
    formations = {}
    for title, places in tables.formations.items():
        for name in places:
            if name not in names:
                hint = nearest(name, names) or f"the vehicles are {', '.join(names)}"
                raise Invalid(f"{source}: formations.{title}: there is no vehicle {name}", hint)
        formations[title] = {
            name: _place(value, f"{source}: formations.{title}.{name}")
            for name, value in places.items()
        }
        _check_apart(formations[title], f"{source}: formations.{title}")
    return FleetFile(members, formations, source)


def _member(name: str, value: Any, source: str, connect: str) -> Member:
    where = f"{source}: vehicles.{name}"
    found = _checked(value, _Entry, where, _EXAMPLE)
    try:
        vehicle = vehicle_name(found.vehicle or name)
    except UsageError as problem:
        raise Invalid(f"{where}: {problem.message}", problem.hint) from problem
    if found.connect:
        try:
            endpoints.check(found.connect)
        except UsageError as problem:
            raise Invalid(f"{where}.connect: {problem.message}", problem.hint) from problem
    return Member(name, found.connect or connect, vehicle)


def _check_distinct(members: list[Member], source: str) -> None:
    taken: dict[tuple[str, str], str] = {}
    for member in members:
        other = taken.setdefault((member.connect, member.vehicle), member.name)
        if other != member.name:
            raise Invalid(
                f"{source}: vehicles.{member.name} is the same vehicle as {other}",
                "give it another `connect`, or set `vehicle` to its name on that hub",
            )


def _place(value: Any, where: str) -> Position:
    if not isinstance(value, list) or len(value) != 3:
        raise Invalid(f"{where}: {catalogue.value(value)} is not a point", _POINT)
    x, y, z = (
        _checked(part, Metres, f"{where}: {axis} = {catalogue.value(part)}", _POINT)
        for axis, part in zip("xyz", value, strict=True)
    )
    return Position(x, y, z)


def _check_apart(places: dict[str, Position], where: str) -> None:
    taken: dict[tuple[Any, ...], str] = {}
    for name, place in places.items():
        other = taken.setdefault(msgspec.structs.astuple(place), name)
        if other != name:
            raise Invalid(
                f"{where}: {name} has the same place as {other}",
                "they would collide: give it another",
            )


def _checked(value: Any, type_: type[T], where: str, hint: str) -> T:
    try:
        return converted(value, type_)
    except msgspec.ValidationError as error:
        text = str(error)
        raise Invalid(f"{where}: {text[:1].lower()}{text[1:]}", hint) from error
