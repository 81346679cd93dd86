"""Checked parameters from defaults, TOML and `--set`, for one vehicle or many."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from quadctl.schemas.params import DynamicsParams, Params, SafetyParams, WindParams
from quadctl.schemas.topics import SETPOINT
from quadctl.schemas.typed import converted
from quadctl.services.airspace import airworthiness
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.files import read_text
from quadctl.services.runtime.params.names import (
    MOST_PARTS,
    flatten,
    has_endless_key,
    nearest,
    put,
    value_of,
)
from quadctl.services.runtime.realm import DEFAULT, listed

_WRITTEN = "`quadctl init` writes one"
_AIRWORTHY = "less wind, mass or motor_lag, softer gains, more tilt or stronger motors"
_NO_PROMISE = "a launch with `dynamics.unproven = true`, without the promises"
_UNPROVEN = f"values nearer to it, or {_NO_PROMISE}"
_DECLARED = ("reaction", "max_acceleration", "min_deceleration")
"""Parameters of safety for the stop of an autopilot that is not ours."""
_LEAST_HEIGHT = 0.01
"""Least vertical distance of two vehicles, m: the square of one far below is 0. The declared bound, above 0, is
a part of the contract."""
_HALF = r"[=\[,]\s*[+-]?(\.\d|\d+\.(?!\d))"
_DIGITS = "TOML has digits on both sides of a point: 0.5 and 5.0, for .5 and 5."
_AT = r"(?s)^(?P<what>.*?)(?: - at `\$\.?(?P<where>[^`]*)`)?$"
_UNKNOWN = r"unknown field `(?P<name>.*)`"


def load(file: Path | None, settings: Iterable[str] = (), running: Params | None = None) -> Params:
    """Load the parameters: `name=value` settings override the file, or else defaults or `running`.

    Raises Invalid, with the file, the path in it, the expected value and the nearest name.
    """
    return check(*gather(file, settings, running))


def gather(
    file: Path | None, settings: Iterable[str] = (), running: Params | None = None
) -> tuple[dict[str, Any], str]:
    """Return the tables that `load` checks, and a text that names their source."""
    table = msgspec.to_builtins(running or {}) if file is None else read(file)
    source = "the defaults" if file is None else str(file)
    for setting in settings:
        name, separator, text = setting.partition("=")
        if not separator:
            raise Invalid(f"--set {setting}: no '='", "write --set safety.virtual_cage.x=3")
        put(table, name.strip(), value_of(text.strip()), f"--set {setting}")
        source += f" with --set {setting}"
    return table, source


def check(table: Mapping[str, Any], source: str, *, in_wind: bool = True) -> Params:
    """Convert plain tables to Params of a vehicle that can fly; raises Invalid with the source.

    A running vehicle may be in a wind that it cannot hold: without `in_wind` it is judged in still
    air.
    """
    params = _typed(table, source)
    dynamics = params.dynamics
    wind = dynamics.wind if in_wind else WindParams()
    if why := airworthiness.why_not(dynamics.vehicle, dynamics.control, wind):
        raise Invalid(f"{source}: dynamics: this vehicle would not fly: {why}", _AIRWORTHY)
    if not dynamics.unproven and (
        why := airworthiness.why_unproven(dynamics.vehicle, dynamics.control)
    ):
        raise Invalid(f"{source}: dynamics: {why}", _UNPROVEN)
    check_range(params, wind, source)
    if (height := params.safety.separation.height) < _LEAST_HEIGHT:
        raise Invalid(
            f"{source}: safety.separation.height: no distance can be computed for {height:g} m, less than"
            f" {_LEAST_HEIGHT:g} m",
            "a greater height; `safety.separation.radius = 0` turns the separation off",
        )
    if "dynamics" not in params.processes:
        _check_timeout(dynamics, source)
    if not (dynamics.unproven or "dynamics" in params.processes):
        _check_guards(params.safety, dynamics, wind, source)
    return params


def _typed(table: Mapping[str, Any], source: str) -> Params:
    try:
        return converted(table, Params)
    except msgspec.ValidationError as error:
        raise _explain(str(error), source) from error


def check_range(params: Params, wind: WindParams, source: str) -> None:
    """Raise Invalid for an acceptance range in which the vehicle cannot hold its place in this wind."""
    dynamics, given = params.dynamics, params.safety.acceptance_range
    least = airworthiness.least_range(dynamics.vehicle, dynamics.control, wind)
    if given < least:
        raise Invalid(
            f"{source}: safety.acceptance_range: {given:g} m is less than the vehicle can hold, {least:.2g} m",
            "a wider range",
        )


def _check_timeout(dynamics: DynamicsParams, source: str) -> None:
    """Raise Invalid for a timeout that ends before the next setpoint is due: safety answers one pose in each period."""
    longest = math.ceil(dynamics.rate / SETPOINT.hz) / dynamics.rate
    if dynamics.setpoint_timeout < longest:
        raise Invalid(
            f"{source}: dynamics.setpoint_timeout: {dynamics.setpoint_timeout:g} s is less than the time"
            f" between two setpoints at {dynamics.rate:g} poses per second, {longest:.2g} s: the vehicle"
            " would brake in each",
            "a longer one, or another dynamics.rate",
        )


def _check_guards(
    safety: SafetyParams, dynamics: DynamicsParams, wind: WindParams, source: str
) -> None:
    """Raise Invalid for guards that would stop sound flights of the simulated vehicle."""
    speed, deceleration = airworthiness.most_motion(dynamics.vehicle, dynamics.control, wind)
    for name, guard, most, unit in (
        ("max_speed", safety.max_speed, speed, "m/s"),
        ("max_deceleration", safety.max_deceleration, deceleration, "m/s^2"),
    ):
        if guard < most:
            raise Invalid(
                f"{source}: safety.{name}: {guard:g} {unit} is less than the vehicle may reach,"
                f" {most:.3g} {unit}: safety would stop sound flights",
                "a higher one, or lower limits in dynamics.control",
            )
    for name in _DECLARED:
        if value := getattr(safety, name):
            raise Invalid(
                f"{source}: safety.{name}: {value:g} describes an autopilot that is not ours",
                f"leave it out, name its adapter in [processes], or {_NO_PROMISE}",
            )


def check_value(name: str, value: Any, source: str) -> None:
    """Check the type and bounds of one parameter; raises Invalid with the source.

    Rules between several parameters are left to the node, which knows the others.
    """
    type_: Any = Params
    for part in name.split("."):
        table = getattr(type_, "__origin__", type_)  # without its Annotated
        type_ = getattr(table, "__annotations__", {}).get(part)
    if type_ is None:
        raise Invalid(f"{source}: unknown parameter {name}", nearest_declared(name))
    try:
        converted(value, type_)
    except msgspec.ValidationError as error:
        raise _explain(str(error), f"{source}: {name}") from error


def read(file: Path, hint: str = _WRITTEN) -> dict[str, Any]:
    """Read the unchecked tables of a TOML file; raises Invalid, with `hint` if it is unreadable."""
    return parse(read_text(file, hint).text, str(file))


def parse(text: str, source: str) -> dict[str, Any]:
    """Parse the unchecked tables of a TOML text; raises Invalid if it is not TOML."""
    import tomllib

    if has_endless_key(text):
        raise Invalid(f"{source} has a key of more than {MOST_PARTS} parts", "no name has so many")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        import re

        named = re.search(r"at line (\d+)", str(error))
        line = text.splitlines()[int(named[1]) - 1] if named else ""
        hint = _DIGITS if re.search(_HALF, line) else "see the line and column named"
        raise Invalid(f"{source} is not TOML: {error}", hint) from error


def _explain(text: str, source: str) -> Invalid:
    import re

    found = re.match(_AT, text)
    what, where = (found["what"], found["where"] or "") if found else (text, "")
    if unknown := re.search(_UNKNOWN, what):
        name = f"{where}.{unknown['name']}".lstrip(".")
        return Invalid(f"{source}: unknown parameter {name}", nearest_declared(name))
    # A rule that spans several tables has an empty `where`.
    return Invalid(
        ": ".join(filter(None, (source, where, f"{what[:1].lower()}{what[1:]}"))),
        "`quadctl init fresh.toml` writes every parameter's bounds and meaning",
    )


def nearest_declared(name: str) -> str:
    """Return a hint with the most similar declared parameter or table, except a table of its own."""
    defaults = msgspec.to_builtins(Params())
    names = [leaf for leaf, _ in flatten(defaults)]
    tables = {leaf.rpartition(".")[0] for leaf in names} - {name.rpartition(".")[0]}
    return nearest(name, [*names, *tables]) or "`quadctl init` writes a file with every parameter"


def launch_lines(section: Struct, like: Struct | None = None) -> Iterator[str]:
    """Yield a node's log lines at launch, in the lab's form: `Param: acceptance range - 0.5`.

    For a vehicle other than the first, only the values that differ from the first one's, `like`.
    """
    known = dict(flatten(msgspec.to_builtins(like))) if like is not None else {}
    shown = [
        (name, value)
        for name, value in flatten(msgspec.to_builtins(section))
        if like is None or known[name] != value
    ]
    if like is None:
        yield "Launching with the following parameters:"
    elif shown:
        yield "Launching with the first vehicle's parameters but for the following:"
    for name, value in shown:
        yield f"Param: {name.replace('_', ' ').replace('.', ' ')} - {value}"


MOST = 1000
"""Vehicles in one run. The time in which a hub learns their endpoints grows with the square of their number."""
_GRID, _RADII = 2.0, 2.2
"""Metres between two vehicles at the start, and radii of their separation, if that is more."""
_SHARED = ("hub", "supervise", "processes", "dynamics.speed", "dynamics.lockstep")
"""Parameters that all vehicles of a run share."""


def names(stem: str, count: int) -> list[str]:
    """Return the names `uav0`, `uav1` ..; raises UsageError for a count outside 1 to MOST."""
    if not 1 <= count <= MOST:
        raise UsageError(f"--vehicles {count}: not a number of vehicles", f"give 1 to {MOST}")
    return [f"{stem}{number}" for number in range(count)]


def load_vehicles(
    file: Path | None, settings: Iterable[str] = (), vehicles: Sequence[str] = (DEFAULT,)
) -> dict[str, Params]:
    """Load each vehicle's parameters; a table named after a vehicle overrides the common values.

    Without own values, several vehicles start on a grid of 2 m around `dynamics.start`, and their
    seeds count up from `dynamics.seed`. Raises Invalid as `load` does.
    """
    return of(*gather(file, settings), vehicles)


def of(table: Mapping[str, Any], source: str, vehicles: Sequence[str]) -> dict[str, Params]:
    """Return each vehicle's parameters as `load_vehicles`, from tables that came from `source`."""
    table = dict(table)
    overrides = {name: table.pop(name, {}) for name in vehicles}
    common = msgspec.to_builtins(_common(table, source, vehicles))
    fleet = {}
    for number, (name, own) in enumerate(overrides.items()):
        _check_own(name, own, source)
        placed = merged(common, _place(common, number, len(vehicles)))
        fleet[name] = check(merged(placed, own), f"{source}: {name}" if own else source)
    return fleet


def table_of(table: Mapping[str, Any], vehicle: str, vehicles: Iterable[str]) -> dict[str, Any]:
    """Merge a file's common tables with the vehicle's own; the vehicle's own values win."""
    common = {name: value for name, value in table.items() if name not in vehicles}
    return merged(common, table.get(vehicle, {}))


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Merge nested tables; the values of `above` win."""
    whole = dict(below)
    for name, value in above.items():
        under = whole.get(name)
        if isinstance(value, Mapping) and isinstance(under, Mapping):
            whole[name] = merged(under, value)
        else:
            whole[name] = value
    return whole


def _common(table: dict[str, Any], source: str, vehicles: Sequence[str]) -> Params:
    # Whether it flies is known with the vehicle's own values only.
    try:
        return _typed(table, source)
    except Invalid as problem:
        stray = next((name for name in table if name not in Params.__struct_fields__), "")
        own = table.get(stray)
        if not isinstance(own, dict):
            raise
        if len(vehicles) > 1:
            hint = f"the vehicles are {listed(vehicles)}; {problem.hint}"
        elif own.keys() & {*Params.__struct_fields__}:
            hint = f"the only vehicle is {listed(vehicles)}: `quadctl up --vehicles N` has more"
        else:
            raise
        raise Invalid(problem.message, hint) from None


def _check_own(name: str, own: Any, source: str) -> None:
    if not isinstance(own, dict):
        raise Invalid(
            f"{source}: {name} is a vehicle, and not a parameter",
            f"name one of its parameters: {name}.safety.takeoff",
        )
    for shared in _SHARED:
        table, _, leaf = shared.partition(".")
        if table in own and (not leaf or leaf in own[table]):
            raise Invalid(f"{source}: {name}.{shared}: all vehicles share one", f"set {shared}")


def _place(common: Mapping[str, Any], number: int, count: int) -> dict[str, Any]:
    """Return a vehicle's start on a square grid, and the seed of its random numbers."""
    columns = math.isqrt(count - 1) + 1
    rows = -(-count // columns)
    row, column = divmod(number, columns)
    start, seed = common["dynamics"]["start"], common["dynamics"]["seed"]
    grid = max(_GRID, _RADII * common["safety"]["separation"]["radius"])
    x = start["x"] + grid * (column - (columns - 1) / 2)
    y = start["y"] + grid * (row - (rows - 1) / 2)
    return {"dynamics": {"start": {"x": x, "y": y}, "seed": (seed + number) % 2**31}}
