"""The vehicle flown by MAVSDK, unmodified: versions 4 and 3, which share no code in Python."""

import json
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import pytest

import quadctl
from quadctl.services.runtime.bus.session import free_port
from tests.support.mavlink import bridge

DONE = dict.fromkeys(
    (
        "set", "arm", "takeoff", "inside", "hold", "fence", "no fence", "mission", "start", "return",
    ),
    "SUCCESS",
)  # fmt: skip
EXPECTED = {
    **DONE,
    **dict.fromkeys(("healthy", "up", "there", "why", "flown", "landed", "all parameters"), True),
    "takeoff height": 1.0,
    "cage": 5.0,
    "outside": "COMMAND_DENIED",
    "in the fence": "COMMAND_DENIED",
    "mission back": 3,
}


def fly(python: str, program: str) -> dict[str, Any]:
    """Return the results that a program prints."""
    port = free_port()
    script = Path(__file__).with_name(program)
    with quadctl.launch() as run, bridge(run.realm, port):
        done = subprocess.run(
            [python, script, str(port)], check=True, timeout=110, stdout=subprocess.PIPE, text=True
        )
        found = json.loads(done.stdout.splitlines()[-1])
        assert run.vehicle.params["safety.acceptance_range"] == 0.375
        # It is fixed at launch.
        assert found.pop("set the seed") != "SUCCESS"
        assert run.vehicle.params["dynamics.seed"] == 0
        assert run.vehicle.params["safety.zones"] == []
        results: dict[str, Any] = found
        return results


@pytest.mark.thorough
def test_mavsdk_4_flies_the_checkpoints_a_fence_and_a_mission():
    found = fly(sys.executable, "mavsdk4.py")
    assert found == {**EXPECTED, "fence back": [4, 0.5]}


@pytest.mark.prove
def test_mavsdk_3_flies_the_checkpoints_a_fence_and_a_mission(tmp_path: Path):
    # Both versions have the same package name, so this one is installed beside us.
    venv.create(tmp_path, with_pip=False)
    python = str(tmp_path / "bin" / "python")
    install = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet"]
    subprocess.run([*install, "mavsdk==3.15.3"], check=True, timeout=120)
    found = fly(python, "mavsdk3.py")
    assert found == EXPECTED
