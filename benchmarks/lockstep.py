"""Speed of simulated time in lock-step, with the real processes and every pose recorded."""

import json
from pathlib import Path

from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.system import Home, running
from quadctl.services.dynamics.compiler import have_made

_MISSION = Path(__file__).parents[1] / "examples" / "mission.toml"
_HOVER = 'end = 60.0\nrows = [{ at = 3.0, do = "calibrate" }]\n'
"""Mission of a take-off and a vehicle at rest: the cost is that of the bus and its processes."""


def measure(results: Results, effort: Effort) -> None:
    """Measure simulated seconds per second, in hover and in the example mission.

    The vehicle's compiled code exists by then: it is made once per machine.
    """
    have_made()
    with running("--set", "dynamics.speed=0") as where:
        hover = where.folder / "hover.toml"
        hover.write_text(_HOVER, encoding="utf-8")
        for number in range(effort.flights):
            results.add("hover_speed", "ours", [_speed(where, hover)], run=number)
            results.add("mission_speed", "ours", [_speed(where, _MISSION)], run=number)


def _speed(where: Home, mission: Path) -> float:
    flown = json.loads(where.quadctl("fly", str(mission), "--json"))
    return float(flown["simulated_seconds"] / flown["wall_seconds"])
