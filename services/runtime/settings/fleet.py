"""The vehicles of a run: their names, and the parameters of each."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from schemas.params import Params
from services.runtime.errors import Invalid, UsageError
from services.runtime.realm import DEFAULT, listed
from services.runtime.settings.params import check, gather

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


def load(
    file: Path | None, settings: Iterable[str] = (), vehicles: Sequence[str] = (DEFAULT,)
) -> dict[str, Params]:
    """Each vehicle's parameters; a table named after it says what it has otherwise.

    Unless they say where, several start on a grid of 2 m around `dynamics.start`, and each has a
    seed of its own, counted up from `dynamics.seed`. Raises Invalid as params.load does.
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
