"""`zone list`, `add` and `remove`: stay-out and stay-in zones of a running vehicle."""

from pathlib import Path
from typing import Annotated, Any

from msgspec import ValidationError, to_builtins

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg
from quadctl.parameters import RunningParams
from quadctl.schemas.topics import ZONES
from quadctl.schemas.typed import converted
from quadctl.schemas.zones import FARTHEST, ZoneParams
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.load import read

_PARAMETER = "safety.zones"
_EXAMPLE = "the page about zones in the book has an example"


def list_(options: Options) -> None:
    """List the zones that are in force while the cage is on.

    Example: quadctl zone list
    """
    with context.connect(options) as client:
        zones = [zone.params for zone in client.latest(ZONES).zones]
    if options.json:
        output.document(to_builtins(zones))
    elif zones:
        output.table([("NAME", "KIND", "SHAPE", "FLOOR", "CEILING"), *map(_row, zones)])
    else:
        output.line("no zones")


def add(
    options: Options, file: Annotated[Path, Arg("TOML file with [[safety.zones]] tables.")]
) -> None:
    """Add the zones of a file, all or none; they hold at once, also for a flight.

    Example: quadctl zone add tower.toml
    """
    fresh = zones_of(file)
    with context.running_params(options) as running:
        _set(running, [*_present(running), *fresh])
    _report(options, "added", [zone["name"] for zone in fresh])


def remove(options: Options, names: Annotated[list[str], Arg("Names of zones.")]) -> None:
    """Remove zones by name, all or none.

    Example: quadctl zone remove tower
    """
    with context.running_params(options) as running:
        present = _present(running)
        known = [zone["name"] for zone in present]
        if unknown := [name for name in names if name not in known]:
            hint = f"it has {', '.join(known)}" if known else "it has none; `quadctl zone list`"
            raise Invalid(f"there is no zone {', '.join(unknown)}: nothing was changed", hint)
        _set(running, [zone for zone in present if zone["name"] not in names])
    _report(options, "removed", names)


def zones_of(file: Path) -> list[dict[str, Any]]:
    """Return the checked zones of a TOML file, plain; raise Invalid for a fault or none."""
    tables = read(file, _EXAMPLE)
    safety = tables.get("safety")
    found = safety.get("zones") if isinstance(safety, dict) else tables.get("zones")
    if not found:
        raise Invalid(f"{file} has no [[safety.zones]]", _EXAMPLE)
    try:
        zones = converted(found, list[ZoneParams])
    except ValidationError as error:
        raise Invalid(f"{file}: {error}", _EXAMPLE) from error
    return [to_builtins(zone) for zone in zones]


def _present(running: RunningParams) -> list[dict[str, Any]]:
    return list(running.get([_PARAMETER])[_PARAMETER])


def _set(running: RunningParams, zones: list[dict[str, Any]]) -> None:
    reply = running.set("safety", {_PARAMETER: zones})
    if not reply.success:
        reason = reply.reason.removeprefix("param set: ")
        raise Invalid(
            f"nothing was changed: {reason}", "`quadctl zone list` shows the present ones"
        )


def _report(options: Options, done: str, names: list[str]) -> None:
    output.either(options, {done: names}, f"{done}: {', '.join(names)}")


def _row(zone: ZoneParams) -> tuple[str, ...]:
    circle = zone.circle
    round_ = f"circle ({circle.x:g}, {circle.y:g}) radius {circle.radius:g}"
    shape = f"{len(zone.polygon)} corners" if zone.polygon else round_
    floor, ceiling = ("-" if abs(z) == FARTHEST else f"{z:g}" for z in (zone.floor, zone.ceiling))
    return zone.name, zone.kind, shape, floor, ceiling
