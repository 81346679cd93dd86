"""Writer of mission files."""

from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any

from quadctl.services.runtime.files import making, write_new
from quadctl.services.runtime.params.catalogue import value
from quadctl.services.runtime.realm import write_atomically


class MissionWriter:
    """New file in the current folder, under the first free name; later missions replace its content."""

    def __init__(self, stem: str) -> None:
        names = (Path(f"{stem}_{number}.toml" if number else f"{stem}.toml") for number in count())
        self.path = next(name for name in names if not name.exists())
        self._is_new = True

    def write(self, mission: Mapping[str, Any]) -> None:
        """Write a mission's tables `end`, `rows` and `set`; raise Invalid if that fails."""
        if self._is_new:
            write_new(self.path, text(mission))
            self._is_new = False
        else:
            with making(self.path):
                write_atomically(self.path, text(mission).encode())


def text(mission: Mapping[str, Any]) -> str:
    """Return a mission as TOML, one row a line."""
    rows = (f"    {value(row)}," for row in mission["rows"])
    settings = (f"{value(name)} = {value(part)}" for name, part in mission["set"].items())
    return "\n".join(
        (f"end = {value(mission['end'])}", "rows = [", *rows, "]", "", "[set]", *settings, "")
    )
