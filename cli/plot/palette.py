"""The colours of a flight's picture."""

from collections.abc import Iterable

CAGE, TAKEN, REFUSED, AIR = "#57606a", "#1a7f37", "#cf222e", "#8250df"
STATES = {"HOVERING": "#c9d1d9", "VERIFYING": "#d4a72c", "MOVING": "#79c0ff"}
_PATHS = ("#1f6feb", "#bf5af2", "#e36209", "#0a7f8c", "#8a6d00", "#c2185b", "#2f5d00", "#444c56")


def of_vehicles(names: Iterable[str]) -> dict[str, str]:
    """A colour for each vehicle, again from the first where there are more than that."""
    return {name: _PATHS[number % len(_PATHS)] for number, name in enumerate(names)}
