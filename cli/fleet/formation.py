"""Where each vehicle is to go. Pure."""

from collections.abc import Mapping
from math import fsum

from cli.fleet.file import Fleet
from cli.fleet.words import Said
from schemas.messages import Position
from services.runtime.errors import Invalid
from services.runtime.params.names import nearest

Places = Mapping[str, Position]
"""A point for each vehicle, m."""


def named_goals(said: Said, fleet: Fleet) -> dict[str, Position] | None:
    """The goals of vehicles by name, or of a formation.

    None for a centre, which depends on where all are. Raises Invalid for a name that there is not.
    """
    names = [member.name for member in fleet.members]
    for name in said.own:
        if name not in names:
            hint = nearest(name, names) or f"the vehicles are {', '.join(names)}"
            raise Invalid(f"there is no vehicle {name}", hint)
    if said.own or not said.formation:
        return said.own or None
    if said.formation not in fleet.formations:
        raise _no_formation(said.formation, fleet)
    return _moved(fleet.formations[said.formation], said.at)


def about(places: Places, to: Position) -> dict[str, Position]:
    """The places moved so that their centre is at a point, each as far from it as before."""
    count = len(places)
    x, y, z = (fsum(getattr(p, axis) for p in places.values()) / count for axis in "xyz")
    offsets = {name: Position(p.x - x, p.y - y, p.z - z) for name, p in places.items()}
    return _moved(offsets, to)


def _moved(places: Places, by: Position) -> dict[str, Position]:
    return {name: Position(by.x + p.x, by.y + p.y, by.z + p.z) for name, p in places.items()}


def _no_formation(title: str, fleet: Fleet) -> Invalid:
    source = fleet.source or "fleet.toml"
    table = f"write it in {source}: [formations.{title}], and below it, for each vehicle,"
    known = nearest(title, fleet.formations)
    if fleet.formations and not known:
        known = f"{source} has {', '.join(fleet.formations)}"
    return Invalid(
        f"there is no formation {title}",
        known or f"{table} {fleet.members[0].name} = [1.0, 2.0, 0.5], metres",
    )
