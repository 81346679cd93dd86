"""Output of the commands with --json as keys and JSON types, gathered from one running system."""

import json
import shutil
from pathlib import Path
from typing import Any

from tests.support.bare import Bare
from tests.support.lab import Lab

RECORDING = Path(__file__).parents[1] / "recording" / "data" / "cage.mcap"
MISSION = """
end = 0.5
rows = [
    { at = 0.1, do = "calibrate" },
    { at = 0.1, do = "cage", on = true },
    { at = 0.2, do = "goto", x = 0.5, y = 0.0, z = 1.0 },
    { at = 0.3, do = "goto", x = 9.0, y = 0.0, z = 1.0, replace = true },
    { at = 0.4, do = "hold" },
    { at = 0.4, do = "param", name = "safety.acceptance_range", value = 0.4 },
]
"""
ZONE = """
[[safety.zones]]
name = "tower"
polygon = [[3, 3], [4, 3], [4, 4]]
"""

OFFLINE = (
    "--version",
    "campaign --flights 1 --seconds 4 --seed 3",
    "campaign --replay 3000000 --seconds 4",
    "campaign --search 60 --flights 8 --seconds 4",
    "type list",
    "type show goto",
    "type show Pose",
    "type show nonsense",
    "init other.toml",
    "keys init",
    "keys issue observer anna",
    "keys list",
    "keys revoke anna",
    "bag info flight.mcap",
    "bag check flight.mcap",
    "bag repair flight.mcap",
    "bag export flight.mcap --csv",
    "goto nan 0 1",
    "goto abc 0 1",
    "goto 1 0 1 --realm nowhere",
)
"""Commands that need no system, run one after another."""

LOOKING = (
    "status",
    "ps",
    "state",
    "cage show",
    "zone list",
    "graph",
    "topic list",
    "topic info pose",
    "topic echo pose -n 1",
    "topic echo pose -n 1 --field position",
    "topic echo sensors/pressure -n 1",
    "topic echo safety/state -n 1",
    "topic echo input/position -n 1",
    "topic echo info -n 1",
    "topic echo uav/sensors/* -n 1",
    "topic hz pose -n 4",
    "topic bw pose -n 4",
    "topic delay pose -n 4",
    "service list",
    "service info goto",
    "service call safety/get_params 'names=[\"safety.virtual_cage.x\"]'",
    "param list",
    "param get safety.virtual_cage",
    "param get safety.nonsense",
    "param describe safety.virtual_cage.x",
    "param dump safety",
    "param diff",
    "node list",
    "node info safety",
    "node info hub",
    "node ping safety -c 1",
    "node logs safety -n 1",
    "fault list",
    "fleet list",
    "doctor",
)
"""Commands that change nothing, run at the same time."""

ACTING = (
    "calibrate",
    "goto 0.3 0 1",
    "goto 9 0 1",
    "goto 0.5 0 1 --no-wait --replace",
    "hold",
    "cage on",
    "zone add zone.toml",
    "zone remove tower",
    "service call toggle_cage cage_on=true",
    "service call goto x=0.5 y=0.0 z=1.0 replace=true",
    "topic pub input/position_request {x:0.2,y:0.0,z:1.0} --once",
    "param set safety.acceptance_range 0.4",
    "param set safety.acceptance_range=-1",
    "param save saved.toml",
    "param load saved.toml",
    "fault inject barometer-stuck",
    "status",
    "fault clear",
    "fleet goto 0 0 1 --replace",
    "fleet hold",
    "calibrate --unset",
    "record -d 0.1 -o recorded.mcap",
    "replay flight.mcap",
    "reset",
    "fly mission.toml",
    "fuzz --payloads 20",
    "node restart pressure",
    "node kill pressure",
    "down",
)
"""Commands that act on the system, run one after another in this order."""


def gather(lab: Lab) -> dict[str, Any]:
    """Run every command and return the shapes of the outputs."""
    shutil.copy(RECORDING, lab.folder / "flight.mcap")
    lab.file(MISSION, "mission.toml")
    lab.file(ZONE, "zone.toml")
    lab.file("[safety]\nacceptance_range = 0.5\n", "saved.toml")
    offline = {line: lab.quadctl(*line.split(), "--json") for line in OFFLINE}
    # A goal that is refused, as poses are late on a busy machine, has other fields.
    lab.start("--set", "dynamics.start.z=1", "--set", "safety.pose_timeout=5",
              "--set", "dynamics.setpoint_timeout=5", "--set", "supervise.answer_timeout=60")  # fmt: skip
    with lab.bare() as bare:
        listed = tokens(bare)
        looking = lab.each(LOOKING, "--json")
    acting = {line: lab.quadctl(*line.split(), "--json") for line in ACTING}
    return {
        "tokens": listed,
        "offline": {line: _result(*done) for line, done in offline.items()},
        "looking": {line: _result(*done) for line, done in looking.items()},
        "acting": {line: _result(*done) for line, done in acting.items()},
    }


def tokens(bare: Bare) -> list[str]:
    """Return every liveliness token of the vehicle."""
    patterns = ("uav/@node/*", "uav/@node/*/@pub/**", "uav/@node/*/@srv/**", "uav/@node/*/@sub/**")
    replies = [
        reply
        for pattern in patterns
        for reply in bare.session.liveliness().get(pattern, timeout=3.0)
    ]
    return sorted(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)


def _result(code: int, out: str, err: str) -> dict[str, Any]:
    found: dict[str, Any] = {"exit": code}
    if out:
        found["out"] = _distinct([shape(json.loads(line)) for line in out.splitlines()])
    if code:
        found["error"] = json.loads(err.splitlines()[-1])["error"]["code"]
        found["err"] = shape(json.loads(err.splitlines()[-1]))
    return found


def shape(value: Any) -> Any:
    """Return the keys in order with JSON types; for a list, the distinct shapes of its items."""
    match value:
        case dict():
            return {name: shape(inner) for name, inner in value.items()}
        case list():
            return _distinct([shape(inner) for inner in value])
        case bool():
            return "boolean"
        case int() | float():
            return "number"
        case str():
            return "string"
        case None:
            return "null"
    raise AssertionError(f"not a JSON value: {value!r}")


def _distinct(shapes: list[Any]) -> list[Any]:
    return [one for number, one in enumerate(shapes) if one not in shapes[:number]]
