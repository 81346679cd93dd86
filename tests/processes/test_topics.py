"""What a stranger sees on the topics: rates, latched state, and the lab's unanswered command."""

import math
from itertools import pairwise

import pytest

from tests.processes.bare import Bare, gap, speed
from tests.processes.lab import Lab, eventually

REQUEST = "uav/input/position_request"


def test_the_state_is_latched(bare: Bare):
    state = bare.fly(0.0, 0.0, 1.0)
    got = bare.query("uav/safety/state", b"")
    assert got.encoding.startswith("application/msgpack;quadctl.SafetyState#")
    assert set(state) == {
        "boot", "stamp", "request", "state", "goal", "cage_on", "cage", "reason",
    }  # fmt: skip
    assert got.value["goal"] == {"x": 0.0, "y": 0.0, "z": 1.0}
    assert got.value["cage"] == {"x": 5.0, "y": 5.0, "z": 5.0}
    assert got.value["boot"] == bare.watch("uav/pose").next()[0]["boot"]


def test_info_says_who_serves_what(bare: Bare):
    info = bare.latest("uav/info")
    assert info["vehicle"] == "uav"
    assert info["services"]["goto"] == "safety"
    assert info["services"]["calibrate_pressure"] == "pressure"
    assert info["topics"]["pose"] == "dynamics"


def test_poses_come_at_100_hz_without_a_gap_and_with_all_fields(bare: Bare):
    watch = bare.watch("uav/pose")
    poses = watch.next(200)
    assert {round(b["stamp"] - a["stamp"], 6) for a, b in pairwise(poses)} == {0.01}
    assert {b["seq"] - a["seq"] for a, b in pairwise(poses)} == {1}
    assert len({pose["boot"] for pose in poses}) == 1
    first = poses[0]
    assert set(first["orientation"]) == set("wxyz")
    assert set(first["velocity"]) == set(first["body_rates"]) == set("xyz")
    norm = math.sqrt(sum(part**2 for part in first["orientation"].values()))
    assert norm == pytest.approx(1, abs=1e-6)
    assert watch.encodings[0].startswith("application/msgpack;quadctl.Pose#")


def test_setpoints_answer_every_fifth_pose_in_every_state(bare: Bare):
    bare.fly(0.0, 0.0, 1.0)
    setpoints, states = bare.watch("uav/input/position"), bare.watch("uav/safety/state")
    setpoints.next(20)
    assert bare.call("goto", x=4.0, y=0.0, z=1.0).value["accepted"]
    states.until(lambda s: s["state"] == "HOVERING")
    assert bare.call("goto", x=9.0, y=0.0, z=1.0).value["accepted"] is False
    setpoints.next(20)
    answered = sorted({setpoint["for_seq"] for setpoint in setpoints.messages})
    steps = [b - a for a, b in pairwise(answered)]
    assert set(steps) <= set(range(1, 11)), "a period was left out"
    assert sum(steps) / len(steps) == pytest.approx(5, abs=0.5)


def test_pressure_comes_at_10_hz(bare: Bare):
    stamps = [reading["stamp"] for reading in bare.watch("uav/sensors/pressure").next(20)]
    mean = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
    assert mean == pytest.approx(0.1, abs=0.02)


def test_the_state_is_told_every_second_though_nothing_happens(bare: Bare):
    bare.fly(0.0, 0.0, 1.0)
    quiet = bare.watch("uav/safety/state").next(2)
    assert 0.5 < quiet[1]["stamp"] - quiet[0]["stamp"] < 2


def test_a_published_request_without_a_type_is_flown(bare: Bare):
    bare.fly(0.0, 0.0, 1.0)
    states, poses = bare.watch("uav/safety/state"), bare.watch("uav/pose")
    before = bare.state()["request"]
    goal = {"x": 2.0, "y": 0.0, "z": 1.0}
    bare.put(REQUEST, goal)
    verifying = states.until(lambda s: s["state"] == "VERIFYING")
    assert verifying["request"] == before + 1
    states.until(lambda s: s["state"] == "HOVERING" and s["goal"] == goal)
    poses.until(lambda p: gap(p["position"], goal) < 0.1)


def test_refused_requests_are_counted_and_say_why(bare: Bare):
    goal = bare.fly(0.0, 0.0, 1.0)["goal"]
    states = bare.watch("uav/safety/state")
    before = bare.state()["request"]
    for count in (1, 2):
        bare.put(REQUEST, {"x": 9, "y": 0, "z": 1})
        refused = states.until(
            lambda s, number=before + count: s["request"] == number and s["state"] == "HOVERING"
        )
        assert "x = 9" in refused["reason"]
        assert refused["goal"] == goal


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, "2", None])
def test_a_request_that_is_no_point_is_ignored(bare: Bare, bad: object):
    before = bare.state()
    bare.put(REQUEST, {"x": bad, "y": 0.0, "z": 1.0})
    # Same sender, same link, same inbox: answered after the bad one was read.
    assert bare.call("safety/get_params", names=["safety.takeoff"]).ok
    after = bare.state()
    assert {**after, "stamp": 0} == {**before, "stamp": 0}


def test_a_request_while_moving_is_refused_as_busy(bare: Bare):
    bare.fly(0.0, 0.0, 1.0)
    states, poses = bare.watch("uav/safety/state"), bare.watch("uav/pose")
    assert bare.call("goto", x=-4.5, y=-4.5, z=1.0).value["accepted"]
    bare.put(REQUEST, {"x": 0, "y": 0, "z": 1})
    refused = states.until(lambda s: "busy" in s["reason"])
    assert (refused["state"], refused["goal"]["x"]) == ("MOVING", -4.5)
    states.until(lambda s: s["state"] == "HOVERING" and s["goal"]["x"] == -4.5)
    eventually(lambda: speed(poses.messages[-1]) < 0.1)


def test_a_reset_is_a_new_boot_and_drops_the_goal(shared_lab: Lab, bare: Bare):
    bare.fly(3.0, 0.0, 1.0)
    states, poses = bare.watch("uav/safety/state"), bare.watch("uav/pose")
    old = poses.next()[0]["boot"]
    assert bare.call("goto", x=-4.5, y=0.0, z=1.0).value["accepted"]
    done = shared_lab.quadctl("reset", "--json")
    assert (done.code, done.json) == (0, {"success": True})
    fresh = poses.until(lambda p: p["boot"] != old)
    assert abs(fresh["position"]["x"]) < 0.1
    told = states.until(lambda s: s["boot"] == fresh["boot"])
    assert told["goal"]["x"] == pytest.approx(0, abs=0.1)
    up = states.until(lambda s: s["state"] == "HOVERING" and s["goal"]["z"] > 0.9)
    assert up["goal"]["x"] == pytest.approx(0, abs=0.1)
    assert [s for s in states.messages if "anew" in s["reason"]]
