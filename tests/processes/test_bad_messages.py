"""Whatever a stranger sends, every service answers it, nothing changes, and nothing ends."""

import math
import random
from typing import Any

import pytest

from tests.processes.bare import Bare, pack
from tests.processes.lab import Lab

ERROR = "application/json;quadctl.Error"
BAD: dict[str, list[Any]] = {
    "goto": [
        *({"x": bad, "y": 0.0, "z": 1.0} for bad in (math.nan, math.inf, -math.inf, 1e300, 10_001)),
        {"x": 1.0, "y": math.nan, "z": 1.0},
        {"x": 1.0, "y": 0.0},
        {},
        {"x": "1", "y": 0.0, "z": 1.0},
        {"x": 1.0, "y": 0.0, "z": 1.0, "speed": 2.0},
        {"x": 1.0, "y": 0.0, "z": 1.0, "replace": "yes"},
        [1.0, 0.0, 1.0],
        None,
    ],
    "calibrate_pressure": [{}, {"zero": 1}, {"zero": "true"}, {"zero": True, "more": 1}, True],
    "toggle_cage": [{}, {"cage_on": 0}, {"cage_on": None}, {"cage_on": False, "more": 1}, [False]],
    "hold": [{"now": True}, [], None, 7],
    "reset": [{"now": True}, [], None, 7],
    "safety/get_params": [{}, {"names": "safety"}, {"names": [1]}, {"names": ["safety.nonsense"]}],
    "safety/set_params": [{}, {"values": []}, {"values": {1: 2}}],
    "pressure/set_params": [{}, {"values": 1}],
    "dynamics/set_params": [{}, {"values": None}],
    "hub/get_params": [{"names": {}}, 3],
}


def condition(bare: Bare) -> Any:
    """All that a bad call must not change."""
    reading = bare.watch("uav/sensors/pressure").next()[0]
    pose = bare.watch("uav/pose").next()[0]
    state = {**bare.state(), "stamp": 0}
    return state, reading["baseline"], pose["boot"], bare.call("safety/get_params", names=[]).value


def pids(lab: Lab) -> dict[str, int]:
    return {name: node["pid"] for name, node in lab.nodes().items()}


@pytest.mark.parametrize("service", BAD)
def test_a_request_that_cannot_be_is_answered_invalid_and_changes_nothing(
    hover: Bare, service: str
):
    before = condition(hover)
    for value in BAD[service]:
        answer = hover.query(f"uav/@srv/{service}", pack(value))
        assert (answer.ok, answer.encoding) == (False, ERROR), value
        assert answer.code == "invalid", value
        assert answer.value["message"]
    assert condition(hover) == before


def test_random_bytes_on_every_service_are_answered_and_change_nothing(
    shared_lab: Lab, hover: Bare
):
    before, running = condition(hover), pids(shared_lab)
    rng = random.Random(1)
    valid = {
        "x": 1.0,
        "y": 0.0,
        "z": 1.0,
        "zero": True,
        "cage_on": False,
        "names": [],
        "values": {},
    }
    for service in BAD:
        for number in range(40):
            junk = bytearray(rng.randbytes(rng.randrange(60)))
            if number % 2:
                junk = bytearray(pack(valid))
                junk[rng.randrange(len(junk))] ^= 1 << rng.randrange(8)
            answer = hover.query(f"uav/@srv/{service}", bytes(junk))
            assert (answer.code, answer.encoding) == ("invalid", ERROR), (service, bytes(junk))
    assert condition(hover) == before
    assert pids(shared_lab) == running
    assert hover.call("goto", x=0.5, y=0.0, z=1.0).value["accepted"]
    assert hover.call("calibrate_pressure", zero=True).ok


def test_random_bytes_on_every_topic_end_no_process(shared_lab: Lab, hover: Bare):
    running, rng = pids(shared_lab), random.Random(2)
    keys = ["pose", "sensors/pressure", "safety/state", "input/position_request", "input/position"]
    for key in [*keys, "info", "anything"]:
        for _ in range(100):
            hover.session.put(f"uav/{key}", rng.randbytes(rng.randrange(60)))
    for node in ("safety", "dynamics", "pressure"):
        assert hover.call(f"{node}/get_params", names=[]).ok
    assert hover.call("goto", x=0.5, y=0.0, z=1.0).value["accepted"]
    assert pids(shared_lab) == running


def test_poses_with_nan_and_infinity_do_not_reach_safety(hover: Bare):
    pose = hover.watch("uav/pose").next()[0]
    for bad in (math.nan, math.inf, 1e300):
        forged = {**pose, "position": {"x": bad, "y": 0.0, "z": 1.0}}
        hover.put("uav/pose", forged)
    state = hover.state()
    assert state["boot"] == pose["boot"]
    assert all(math.isfinite(part) for part in state["goal"].values())
    assert hover.call("goto", x=0.5, y=0.0, z=1.0).value["accepted"]


def test_parameters_out_of_bounds_change_nothing(hover: Bare):
    before = condition(hover)
    for name, value in {
        "virtual_cage.x": math.nan,
        "virtual_cage.y": 0.0,
        "acceptance_range": math.inf,
        "cage_on": "yes",
        "nonsense": 1.0,
        "pose_timeout": [1],
    }.items():
        values = {"safety.virtual_cage.z": 3.0, f"safety.{name}": value}
        reply = hover.call("safety/set_params", values=values)
        assert reply.ok
        assert reply.value["success"] is False
        assert name.partition(".")[0] in reply.value["reason"]
    assert condition(hover) == before
