"""Checked parameters from defaults, TOML and `--set`, for one vehicle or many."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from quadctl.schemas import airworthy
from quadctl.schemas.params import Params
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.params.names import flatten, nearest, put, value_of
from quadctl.services.runtime.realm import DEFAULT, listed

_WRITTEN = "`quadctl init` writes one"
_AIRWORTHY = "less wind, mass or motor_lag, softer gains, more tilt or stronger motors"
_MOST_BYTES = 1_000_000
"""Of a file: that of a thousand vehicles has a tenth of it."""
_AT = re.compile(r"^(?P<what>.*?)(?: - at `\$\.?(?P<where>[^`]*)`)?$", re.DOTALL)
_UNKNOWN = re.compile(r"unknown field `(?P<name>.*)`")


def load(file: Path | None, settings: Iterable[str] = (), running: Params | None = None) -> Params:
    """Defaults or a running system's values, below the file, below `name=value` settings.

    Raises Invalid with the file, the path in it, what was expected and the nearest name.
    """
    return check(*gather(file, settings, running))


def gather(
    file: Path | None, settings: Iterable[str] = (), running: Params | None = None
) -> tuple[dict[str, Any], str]:
    """The tables that `load` checks, and where they come from."""
    table = msgspec.to_builtins(running or {}) if file is None else read(file)
    source = "the defaults" if file is None else str(file)
    for setting in settings:
        name, separator, text = setting.partition("=")
        if not separator:
            raise Invalid(f"--set {setting}: no '='", "write --set safety.virtual_cage.x=3")
        put(table, name.strip(), value_of(text.strip()), f"--set {setting}")
        source += f" with --set {setting}"
    return table, source


def check(table: Mapping[str, Any], source: str) -> Params:
    """Turn plain tables into Params of a vehicle that can fly; raises Invalid, naming the source."""
    try:
        params = msgspec.convert(table, Params)
    except msgspec.ValidationError as error:
        raise _explain(str(error), source) from error
    flown = params.dynamics
    if why := airworthy.why_not(flown.vehicle, flown.control, flown.wind):
        raise Invalid(f"{source}: dynamics: this vehicle would not fly: {why}", _AIRWORTHY)
    return params


def read(file: Path, hint: str = _WRITTEN) -> dict[str, Any]:
    """The tables of a TOML file, not checked; raises Invalid where it is none.

    Where it cannot be read, the hint says where such a file comes from.
    """
    return parse(read_text(file, hint), str(file))


def read_text(file: Path, hint: str = _WRITTEN) -> str:
    """A file's text as it is, its line ends too; raises Invalid where it cannot be had."""
    try:
        with file.open("rb") as opened:
            # A pipe may be read, but a device has no end.
            found = opened.read(_MOST_BYTES + 1)
        if len(found) > _MOST_BYTES:
            raise Invalid(f"{file} is no such file: it has more than 1 MB", hint)
        return found.decode()
    except OSError as error:
        raise Invalid(f"{file} cannot be read: {error.strerror}", hint) from error
    except UnicodeDecodeError as error:
        raise Invalid(f"{file} is not TOML: {error}", "TOML is written in UTF-8") from error


def parse(text: str, source: str) -> dict[str, Any]:
    """The tables of a TOML text, not checked; raises Invalid where it is none."""
    import tomllib

    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise Invalid(f"{source} is not TOML: {error}", "see the line and column named") from error


def _explain(text: str, source: str) -> Invalid:
    found = _AT.match(text)
    what, where = (found["what"], found["where"] or "") if found else (text, "")
    unknown = _UNKNOWN.search(what)
    if unknown:
        name = f"{where}.{unknown['name']}".lstrip(".")
        return Invalid(f"{source}: unknown parameter {name}", nearest_declared(name))
    said = f"{what[:1].lower()}{what[1:]}"
    # A rule between tables has no place of its own.
    return Invalid(
        ": ".join(filter(None, (source, where, said))),
        "`quadctl init fresh.toml` writes every parameter's bounds and meaning",
    )


def nearest_declared(name: str) -> str:
    """A hint that names the likeliest declared parameter or table meant."""
    defaults = msgspec.to_builtins(Params())
    names = [leaf for leaf, _ in flatten(defaults)]
    tables = {leaf.rpartition(".")[0] for leaf in names}
    return nearest(name, [*names, *tables]) or "`quadctl init` writes a file with every parameter"


def launch_lines(section: Struct, like: Struct | None = None) -> Iterator[str]:
    """What a node logs at launch, in the lab's form: `Param: acceptance range - 0.5`.

    Of a vehicle besides the first, what it has otherwise than that: `like`.
    """
    known = dict(flatten(msgspec.to_builtins(like))) if like is not None else {}
    said = [
        (name, value)
        for name, value in flatten(msgspec.to_builtins(section))
        if like is None or known[name] != value
    ]
    if like is None:
        yield "Launching with the following parameters:"
    elif said:
        yield "Launching with the first vehicle's parameters but for the following:"
    for name, value in said:
        yield f"Param: {name.replace('_', ' ').replace('.', ' ')} - {value}"


MOST = 200
"""Vehicles of one run: of 300 a hub takes longer to learn what they offer than a start may take."""
_GRID = 2.0
"""Metres between two vehicles at the start."""
_SHARED = ("hub", "supervise", "processes", "dynamics.speed")
"""What there is one of in a run."""


def names(stem: str, count: int) -> list[str]:
    """`uav0`, `uav1` ..; raises UsageError for a count that is none."""
    if not 1 <= count <= MOST:
        raise UsageError(f"--vehicles {count}: not a number of vehicles", f"give 1 to {MOST}")
    return [f"{stem}{number}" for number in range(count)]


def load_vehicles(
    file: Path | None, settings: Iterable[str] = (), vehicles: Sequence[str] = (DEFAULT,)
) -> dict[str, Params]:
    """Each vehicle's parameters; a table named after it says what it has otherwise.

    Unless they say where, several start on a grid of 2 m around `dynamics.start`, and each has a
    seed of its own, counted up from `dynamics.seed`. Raises Invalid as `load`.
    """
    return of(*gather(file, settings), vehicles)


def of(table: Mapping[str, Any], source: str, vehicles: Sequence[str]) -> dict[str, Params]:
    """As `load`, from tables; raises Invalid, naming the source."""
    table = dict(table)
    own = {name: table.pop(name, {}) for name in vehicles}
    common = msgspec.to_builtins(_common(table, source, vehicles))
    fleet = {}
    for number, (name, said) in enumerate(own.items()):
        _check_own(name, said, source)
        placed = merged(common, _place(common, number, len(vehicles)))
        fleet[name] = check(merged(placed, said), f"{source}: {name}" if said else source)
    return fleet


def said_of(table: Mapping[str, Any], vehicle: str, vehicles: Iterable[str]) -> dict[str, Any]:
    """What a file's tables say of one vehicle: what they say of all, below what of it alone."""
    common = {name: value for name, value in table.items() if name not in vehicles}
    return merged(common, table.get(vehicle, {}))


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables, one laid over the other."""
    whole = dict(below)
    for name, value in above.items():
        under = whole.get(name)
        if isinstance(value, Mapping) and isinstance(under, Mapping):
            whole[name] = merged(under, value)
        else:
            whole[name] = value
    return whole


def _common(table: dict[str, Any], source: str, vehicles: Sequence[str]) -> Params:
    try:
        return check(table, source)
    except Invalid as problem:
        stray = next((name for name in table if name not in Params.__struct_fields__), "")
        if not isinstance(table.get(stray), dict) or len(vehicles) == 1:
            raise
        hint = f"the vehicles are {listed(vehicles)}; {problem.hint}"
        raise Invalid(problem.message, hint) from None


def _check_own(name: str, said: Any, source: str) -> None:
    if not isinstance(said, dict):
        raise Invalid(
            f"{source}: {name} is a vehicle, and not a parameter",
            f"name one of its parameters: {name}.safety.takeoff",
        )
    for shared in _SHARED:
        table, _, leaf = shared.partition(".")
        if table in said and (not leaf or leaf in said[table]):
            raise Invalid(
                f"{source}: {name}.{shared}: there is one for all vehicles",
                f"set {shared}",
            )


def _place(common: Mapping[str, Any], number: int, count: int) -> dict[str, Any]:
    """Where one of several starts, on a square grid, and the seed of its random numbers."""
    columns = math.isqrt(count - 1) + 1
    rows = -(-count // columns)
    row, column = divmod(number, columns)
    start, seed = common["dynamics"]["start"], common["dynamics"]["seed"]
    return {
        "dynamics": {
            "start": {
                "x": start["x"] + _GRID * (column - (columns - 1) / 2),
                "y": start["y"] + _GRID * (row - (rows - 1) / 2),
            },
            "seed": (seed + number) % 2**31,
        }
    }
