"""Judges the parameter file here, and the running nodes' parameters by it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from cli.doctor.check import Check, failed, passed, warned
from cli.fault.catalogue import active
from services.runtime.errors import Invalid
from services.runtime.params.load import load_vehicles
from services.runtime.params.names import flatten

FILE = Path("quad.toml")
_SHOWN = 5
_DEFAULTS = "the defaults"


class Settings(NamedTuple):
    """What the file here says by full dotted names, else the defaults; `error` where it cannot be."""

    source: str
    values: dict[str, Any]
    error: Invalid | None = None

    @property
    def is_file(self) -> bool:
        """Whether there is a file here."""
        return self.source != _DEFAULTS


def settings(vehicle: str, vehicles: Sequence[str], file: Path = FILE) -> Settings:
    """Read those of one of a run's vehicles."""
    there = file.exists()
    source = f"./{file}" if there else _DEFAULTS
    try:
        params = load_vehicles(file if there else None, (), vehicles)[vehicle]
    except Invalid as error:
        return Settings(source, {}, error)
    return Settings(source, dict(flatten(msgspec.to_builtins(params))))


def parameter_file(found: Settings) -> Check:
    """The file here is one that `up` would take."""
    if found.error is not None:
        return failed("parameter file", found.error.message, found.error.hint)
    if not found.is_file:
        return passed("parameter file", f"no {FILE} here: the defaults hold")
    return passed("parameter file", f"{found.source} is valid")


def parameters(found: Settings, running: Mapping[str, Any]) -> Check:
    """The running nodes have the values of the file here."""
    if found.error is not None or not running:
        why = "the file is not valid" if found.error else "no node has told its parameters"
        return warned("parameters", f"not checked: {why}")
    other = [
        f"{name} is {value}, there {found.values[name]}"
        for name, value in sorted(running.items())
        if name in found.values and found.values[name] != value
    ]
    if other:
        more = [f"and {len(other) - _SHOWN} more"] if len(other) > _SHOWN else []
        return warned(
            "parameters",
            "\n".join([f"other than {found.source}:", *other[:_SHOWN], *more]),
            f"`quadctl param save {FILE}` keeps them"
            + (f", `quadctl param load {FILE}` takes the file's" if found.is_file else ""),
        )
    return passed("parameters", f"{len(running)} values are those of {found.source}")


def faults(running: Mapping[str, Any]) -> Check:
    """No fault has been put in by name."""
    there = active(running)
    if there:
        return warned("faults", f"put in: {', '.join(there)}", "`quadctl fault clear`")
    return passed("faults", "none is put in")
