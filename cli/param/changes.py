"""What differs between two sets of parameters, and how it is told."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from cli import output
from cli.options import Options
from cli.param.running import Values, tables
from services.runtime.params import catalogue
from services.runtime.params.load import gather
from services.runtime.params.load import of as params_of
from services.runtime.params.names import flatten

DEFAULT_FILE = Path("quad.toml")


class Change(Struct, frozen=True):
    """A parameter that is not the same on both sides; None where a side has none of that name."""

    name: str
    before: Any
    after: Any

    def __str__(self) -> str:
        """As `safety.takeoff: 1.0 -> 2.0`."""
        return f"{self.name}: {_shown(self.before)} -> {_shown(self.after)}"

    def document(self, before: str = "before", after: str = "after") -> dict[str, Any]:
        """What --json prints of it, the sides named."""
        return {"name": self.name, before: self.before, after: self.after}


def changes(before: Values, after: Values) -> list[Change]:
    """What differs, in the order in which it is declared."""
    names = [*before, *(name for name in after if name not in before)]
    found = [Change(name, before.get(name), after.get(name)) for name in names]
    return [change for change in found if change.before != change.after]


def file_values(file: Path | None, options: Options) -> Values:
    """Every parameter of the vehicle meant as `up FILE` would take it; without a file the defaults."""
    return values_of(*gather(file), options)


def values_of(said: Mapping[str, Any], source: str, options: Options) -> Values:
    """The same of a file's tables; raises Invalid, naming the source."""
    params = params_of(said, source, options.vehicles)[options.vehicle]
    whole = msgspec.to_builtins(params)
    return dict(flatten({name: table for name, table in whole.items() if table}))


def known_of(values: Values, running: Values) -> Values:
    """Those that the running system can be seen to have or not; says what is left out.

    Over --connect the supervisor's own tables cannot be seen, nor those of a node that is down.
    """
    known = {name.partition(".")[0] for name in running}
    if "supervise" in known:
        known.add("processes")
    unseen = {name.partition(".")[0] for name in values} - known
    if unseen:
        left_out = ", ".join(name for name in tables() if name in unseen)
        output.note(f"cannot be seen from here, and is left out: {left_out}")
    return {name: value for name, value in values.items() if name.partition(".")[0] in known}


def lines(found: Iterable[Change]) -> None:
    """Print changes, one a line."""
    for change in found:
        output.line(str(change))


def _shown(value: Any) -> str:
    return "(none)" if value is None else catalogue.word(value)
