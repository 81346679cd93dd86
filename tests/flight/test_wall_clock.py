"""The wall clock is set an hour on and back in flight: no flying process depends on it."""

import ast
import json
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from tests.support.bare import speed
from tests.support.lab import PATIENT, Lab
from tests.support.proofs import Proofs

ROOT = Path(__file__).parents[2]
HERE = ROOT / "tests" / "support"
HOUR = 3600
TIME_OF_DAY = {"time", "time_ns", "datetime", "localtime", "gmtime", "ctime", "strftime"}
MAY_READ = {
    "cli/bag.py": "when a recording began, as a date",
    "cli/doctor/doctor.py": "whether the clock is set at all",
    "cli/fleet/list.py": "the age of a pose, which is only shown",
    "cli/keys.py": "the expiry of a certificate",
    "cli/node/info.py": "when a process was started, as a date",
    "cli/record/record.py": "the date in a file's name",
    "services/runtime/bus/calls.py": "a call's deadline",
    "services/runtime/bus/router.py": "the expiry of a certificate",
    "services/runtime/bus/scheduled_calls.py": "a call's deadline, which the contract has as Unix time",
    "services/runtime/bus/streams.py": "when a subscription begins, and the age of messages",
    "services/runtime/bus/survey.py": "the age of messages, and a call's deadline",
    "services/runtime/security/authority.py": "the expiry of a certificate",
    "services/runtime/security/identity.py": "the expiry of a certificate",
    "services/runtime/security/registry.py": "the expiry of a certificate",
    "services/runtime/server.py": "a call's deadline",
    "services/runtime/supervisor/child.py": "when a line was logged",
    "services/runtime/supervisor/descendants.py": "a name unique to the run",
    "services/runtime/supervisor/logs.py": "when a line was logged",
    "services/runtime/supervisor/supervisor.py": "when a process was started, which is only shown",
}


class Clock:
    """Time of day of a lab's processes, `ahead` s ahead of the real one."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "ahead"
        self.set(0)

    def set(self, ahead: int) -> None:
        mode = "r+b" if self.file.exists() else "wb"
        with self.file.open(mode) as file:
            file.write(ahead.to_bytes(8, sys.byteorder, signed=True))


def fly_through_jumps(lab: Lab, jump: Callable[[int], None]) -> int:
    """Fly to and fro, setting the clock in each flight; return the number of flights."""
    with lab.bare() as bare:
        poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
        legs = ((3.0, HOUR), (-1.0, -HOUR), (3.0, 0))
        for x, ahead in legs:
            goal = {"x": x, "y": 0.0, "z": 1.0}
            assert bare.call("goto", **goal).value == {"accepted": True, "reason": ""}
            poses.until(lambda pose: speed(pose) > 1.0)
            jump(ahead)
            ended = states.until(lambda s: s["goal"] == goal and s["state"] == "HOVERING")  # noqa: B023 - called at once
            assert ended["reason"] == ""
            poses.until(lambda pose: speed(pose) < 0.05)
        assert {b["seq"] - a["seq"] for a, b in pairwise(poses.messages)} == {1}
        assert len({pose["boot"] for pose in poses.messages}) == 1
        assert {state["reason"] for state in states.messages} == {""}
        assert bare.call("calibrate_pressure", zero=True).ok
    assert {node["restarts"] for node in lab.nodes().values()} == {0}
    return len(legs)


def zenoh_timestamp(lab: Lab) -> float:
    """Return the Zenoh timestamp of a message from dynamics, Unix s."""
    with lab.bare() as bare, bare.session.declare_subscriber("uav/pose") as poses:
        stamp = poses.recv().timestamp
        assert stamp is not None
        return stamp.get_time().timestamp()


def test_nodes_fly_on_when_their_clock_jumps_by_an_hour(lab: Lab):
    clock = Clock(lab.folder)
    nodes = {
        name: [
            sys.executable,
            "-P",
            str(HERE / "jumpy.py"),
            str(clock.file),
            f"quadctl.services.{name}",
        ]
        for name in ("dynamics", "pressure", "safety")
    }
    lines = (f"{name} = {json.dumps(command)}\n" for name, command in nodes.items())
    lab.start(lab.file("[processes]\n" + "".join(lines)), "--set", "dynamics.start.z=1", *PATIENT)
    assert fly_through_jumps(lab, clock.set) == 3
    # Proof that the clock has jumped: for safety the deadline of a call sent now is long over.
    clock.set(HOUR)
    assert lab.quadctl("goto", 0, 0, 1, "--json").error["code"] == "expired"


@pytest.mark.prove
def test_all_processes_and_zenoh_fly_on_when_the_clock_jumps(lab: Lab, proofs: Proofs):
    """Set the clock for the hub and the commands as well, as if the machine's clock were set."""
    clock, library = Clock(lab.folder), lab.folder / "wallclock.so"
    source = str(HERE / "wallclock.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
    lab.environment |= {"LD_PRELOAD": str(library), "WALL_CLOCK": str(clock.file)}
    lab.start("--set", "dynamics.start.z=1", *PATIENT)
    clock.set(HOUR)
    assert zenoh_timestamp(lab) == pytest.approx(time.time() + HOUR, abs=60), (
        "Zenoh does not use the shifted clock"
    )
    clock.set(0)
    seen = []

    def jump(ahead: int) -> None:
        clock.set(ahead)
        seen.append(lab.quadctl("node", "ping", "--all", "-n", 1).code)

    times = fly_through_jumps(lab, jump)
    for ahead in (HOUR, -HOUR, 0):
        clock.set(ahead)
        lines = ("goto 1 0 1", "calibrate", "cage on", "topic echo pose -n 1", "goto 0 0 1")
        seen += [lab.quadctl(*line.split()).code for line in lines]
    proofs.add(
        "the wall clock set an hour on and back: flights stopped, poses lost, commands that fail",
        f"none, in {times} flights and of {len(seen)} commands",
        "none",
    )
    assert set(seen) == {0}


def reads_time_of_day(file: Path) -> bool:
    """Return whether a module reads the time of day."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return any(
        (isinstance(node, ast.Attribute) and node.attr in TIME_OF_DAY and _is_clock(node.value))
        or (isinstance(node, ast.ImportFrom) and node.module in {"time", "datetime"})
        for node in ast.walk(tree)
    )


def _is_clock(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id in {"time", "dt", "datetime"}


def test_flight_code_never_reads_the_time_of_day():
    for service in ("dynamics", "pressure", "safety", "hub"):
        files = sorted((ROOT / "services" / service).rglob("*.py"))
        assert files
        assert [str(file) for file in files if reads_time_of_day(file)] == []
    found = {
        file.relative_to(ROOT).as_posix()
        for folder in ("services/runtime", "cli", "src/quadctl")
        for file in (ROOT / folder).rglob("*.py")
        if reads_time_of_day(file)
    }
    assert found == set(MAY_READ)
