"""Writer of mission files."""

from collections.abc import Mapping
from typing import Any

from quadctl.services.runtime.files import free_name, write_new, write_whole
from quadctl.services.runtime.params.catalogue import value


class MissionWriter:
    """New file in the current folder, under the first free name; later missions replace its content."""

    def __init__(self, stem: str) -> None:
        self.path = free_name(stem, ".toml")
        self._is_new = True

    def write(self, mission: Mapping[str, Any]) -> None:
        """Write a mission's tables `end`, `rows` and `set`; raise Invalid if that fails."""
        if self._is_new:
            write_new(self.path, text(mission))
            self._is_new = False
        else:
            write_whole(self.path, text(mission).encode())


def text(mission: Mapping[str, Any]) -> str:
    """Return a mission as TOML, one row a line."""
    rows = (f"    {value(row)}," for row in mission["rows"])
    settings = (f"{value(name)} = {value(part)}" for name, part in mission["set"].items())
    return "\n".join(
        (f"end = {value(mission['end'])}", "rows = [", *rows, "]", "", "[set]", *settings, "")
    )
