"""Checkpoint 1: parameters outside the code change the behaviour and the log of the system."""

import signal
from functools import partial

import pytest

from tests.support.bare import gap
from tests.support.lab import Lab
from tests.support.running import Foreground, eventually

FILE = """
[safety]
acceptance_range = 0.25
virtual_cage = { x = 3.0, y = 3.0, z = 3.0 }
"""
SETTINGS = [
    word
    for name in (
        "virtual_cage.x=3",
        "virtual_cage.y=3",
        "virtual_cage.z=3",
        "acceptance_range=0.25",
    )
    for word in ("--set", f"safety.{name}")
]

SAID = (
    "Requested position: (4, 0, 1)",
    "Requested position: (2, 0, 1)",
    "Current State: VERIFYING",
    "Current State: MOVING",
    "Current State: HOVERING",
)


def has(run: Foreground, line: str) -> bool:
    """Return whether a line is in the output so far."""
    return line in run.log


@pytest.mark.parametrize("way", ["file", "settings"])
def test_a_file_or_settings_change_log_and_behaviour(lab: Lab, way: str):
    run = lab.foreground(*([lab.file(FILE)] if way == "file" else SETTINGS))

    assert "Launching with the following parameters:" in run.log
    for line in (
        "Param: cage x - [-3.0, 3.0]",
        "Param: cage y - [-3.0, 3.0]",
        "Param: cage z - [0.0, 3.0]",
        "Param: acceptance range - 0.25",
    ):
        eventually(partial(has, run, line), describe=lambda: run.log)

    refused = lab.quadctl("goto", 4, 0, 1, "--json")
    assert refused.code == 5
    assert "x = 4 is beyond [-3, 3]" in refused.json["reason"]
    flown = lab.quadctl("goto", 2, 0, 1, "--json")
    assert flown.code == 0
    assert flown.json["arrived"]
    assert flown.json["distance"] < 0.25

    with lab.bare() as bare:
        assert bare.state()["cage"] == {"x": 3.0, "y": 3.0, "z": 3.0}
        here = bare.watch("uav/pose").next()[0]["position"]
        assert gap(here, {"x": 2, "y": 0, "z": 1}) < 0.25
    eventually(lambda: all(line in run.log for line in SAID))
    assert all(f" {name:8} | " in run.log for name in ("dynamics", "pressure", "safety"))
    assert "\033" not in run.log
    run.send(signal.SIGINT)
    assert run.wait() == 130


def test_a_setting_overrides_the_file_and_quad_toml_is_found(lab: Lab):
    lab.file(FILE, "quad.toml")
    lab.start("--set", "safety.virtual_cage.x=1.5")
    shown = lab.quadctl("cage", "show", "--json").json
    assert shown == {"on": True, "x": [-1.5, 1.5], "y": [-3.0, 3.0], "z": [0.0, 3.0], "zones": []}


def test_the_defaults_of_the_code_apply_without_file_or_setting(shared_lab: Lab):
    names = ("safety.virtual_cage", "safety.acceptance_range", "pressure.rate")
    assert shared_lab.quadctl("param", "get", *names, "--json").json == {
        "safety.virtual_cage.x": 5.0,
        "safety.virtual_cage.y": 5.0,
        "safety.virtual_cage.z": 5.0,
        "safety.acceptance_range": 0.5,
        "pressure.rate": 10.0,
    }
