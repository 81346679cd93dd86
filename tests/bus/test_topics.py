"""Topics as a third party sees them: rates, latched state, and the unanswered position request."""

import math
from functools import partial
from itertools import pairwise
from typing import Any

import pytest

from quadctl.schemas.topics import INFO, POSE, TOPICS, ZONES, Topic
from quadctl.services.runtime.bus.client import Client
from tests.support.bare import Bare, gap, speed
from tests.support.lab import Lab

REQUEST = "uav/input/position_request"


def test_the_safety_state_is_latched(hover: Bare):
    got = hover.query("uav/safety/state", b"")
    assert got.encoding.startswith("application/msgpack;quadctl.SafetyState#")
    assert set(got.value) == {
        "boot", "stamp", "request", "state", "goal", "cage_on", "cage", "reason", "leg",
        "legs", "nearest",
    }  # fmt: skip
    assert got.value["goal"] == {"x": 0.0, "y": 0.0, "z": 1.0}
    assert got.value["cage"] == {"x": 5.0, "y": 5.0, "z": 5.0}
    assert got.value["boot"] == hover.watch("uav/pose").next()[0]["boot"]


@pytest.mark.thorough
def test_each_latched_topic_comes_at_once_beside_a_fast_one(
    shared_lab: Lab, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(shared_lab.runtime))
    topics = {topic.key("uav"): topic for topic in (POSE, ZONES, INFO)}
    with Client(shared_lab.realm, "uav") as client:
        for _ in range(3):
            stream, came = client.listen(*topics, held=True), set[str]()
            for _ in range(200):
                message = stream.next(5.0)
                assert message is not None, came
                message.decoded(topics[message.key].type)
                came.add(message.key)
            stream.close()
            assert came == set(topics)


STAMPED = [each for each in TOPICS if each.hz and "stamp" in each.type.__struct_fields__]


@pytest.mark.parametrize("topic", STAMPED, ids=lambda topic: topic.name)
def test_every_topic_comes_at_its_rate_of_simulated_time(hover: Bare, topic: Topic[Any]):
    watch = hover.watch(topic.key("uav"))
    stamps = [message["stamp"] for message in watch.next(4)]
    assert all(b - a <= 1.5 / topic.hz + 1e-6 for a, b in pairwise(stamps)), stamps


def test_info_names_the_node_of_each_service_and_topic(hover: Bare):
    info = hover.latest("uav/info")
    assert info["vehicle"] == "uav"
    assert info["services"]["goto"] == "safety"
    assert info["services"]["calibrate_pressure"] == "pressure"
    assert info["topics"]["pose"] == "dynamics"


def test_poses_arrive_at_100_hz_without_a_gap_and_with_all_fields(hover: Bare):
    watch = hover.watch("uav/pose")
    poses = watch.next(100)
    assert {round(b["stamp"] - a["stamp"], 6) for a, b in pairwise(poses)} == {0.01}
    assert {b["seq"] - a["seq"] for a, b in pairwise(poses)} == {1}
    assert len({pose["boot"] for pose in poses}) == 1
    first = poses[0]
    assert set(first["orientation"]) == set("wxyz")
    assert set(first["velocity"]) == set(first["body_rates"]) == set("xyz")
    norm = math.sqrt(sum(part**2 for part in first["orientation"].values()))
    assert norm == pytest.approx(1, abs=1e-6)
    assert watch.encodings[0].startswith("application/msgpack;quadctl.Pose#")


def test_setpoints_answer_every_fifth_pose_in_every_state(hover: Bare):
    setpoints, states = hover.watch("uav/input/position"), hover.watch("uav/safety/state")
    setpoints.next(10)
    assert hover.call("goto", x=2.0, y=0.0, z=1.0).value["accepted"]
    states.until(lambda s: s["state"] == "MOVING")
    states.until(lambda s: s["state"] == "HOVERING")
    assert hover.call("goto", x=9.0, y=0.0, z=1.0).value["accepted"] is False
    setpoints.next(10)
    answered = sorted({setpoint["for_seq"] for setpoint in setpoints.messages})
    steps = [b - a for a, b in pairwise(answered)]
    assert set(steps) <= set(range(1, 11)), "a period was skipped"
    assert sum(steps) / len(steps) == pytest.approx(5, abs=0.5)


@pytest.mark.thorough
def test_an_idle_vehicle_publishes_pressure_at_10_hz_state_at_1_hz(hover: Bare):
    readings, states = hover.watch("uav/sensors/pressure"), hover.watch("uav/safety/state")
    quiet = states.next(3)
    assert 1 < quiet[2]["stamp"] - quiet[0]["stamp"] < 3
    stamps = [reading["stamp"] for reading in readings.messages]
    mean = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
    assert mean == pytest.approx(0.1, abs=0.02)


@pytest.mark.thorough
def test_a_published_request_without_a_type_is_flown(hover: Bare):
    states, poses = hover.watch("uav/safety/state"), hover.watch("uav/pose")
    before = hover.state()["request"]
    goal = {"x": 2.0, "y": 0.0, "z": 1.0}
    hover.put(REQUEST, goal)
    verifying = states.until(lambda s: s["state"] == "VERIFYING")
    assert verifying["request"] == before + 1
    states.until(lambda s: s["state"] == "HOVERING" and s["goal"] == goal)
    poses.until(lambda p: gap(p["position"], goal) < 0.1)


def test_refused_requests_are_counted_with_their_reason(hover: Bare):
    goal = hover.state()["goal"]
    states = hover.watch("uav/safety/state")
    before = hover.state()["request"]
    for number in (before + 1, before + 2):
        hover.put(REQUEST, {"x": 9, "y": 0, "z": 1})
        refused = states.until(partial(has_verdict, number))
        assert "x = 9" in refused["reason"]
        assert refused["goal"] == goal


def has_verdict(number: int, state: dict[str, Any]) -> bool:
    """Return whether a state has the verdict on the request `number`."""
    return bool(state["request"] == number and state["state"] != "VERIFYING")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, "2", None])
def test_a_request_that_is_not_a_point_is_ignored(hover: Bare, bad: object):
    before = hover.state()
    hover.put(REQUEST, {"x": bad, "y": 0.0, "z": 1.0})
    # Same sender, same link, same queue: this call is answered after the bad request was read.
    assert hover.call("safety/get_params", names=["safety.takeoff"]).ok
    after = hover.state()
    assert {**after, "stamp": 0} == {**before, "stamp": 0}


@pytest.mark.thorough
def test_a_request_while_moving_is_refused_as_busy(hover: Bare):
    states, poses = hover.watch("uav/safety/state"), hover.watch("uav/pose")
    assert hover.call("goto", x=-4.5, y=-4.5, z=1.0).value["accepted"]
    hover.put(REQUEST, {"x": 0, "y": 0, "z": 1})
    refused = states.until(lambda s: "busy" in s["reason"])
    assert (refused["state"], refused["goal"]["x"]) == ("MOVING", -4.5)
    states.until(lambda s: s["state"] == "HOVERING" and s["goal"]["x"] == -4.5)
    poses.until(lambda p: speed(p) < 0.1)


def test_a_reset_is_a_new_boot_and_drops_the_goal(shared_lab: Lab, hover: Bare):
    states, poses = hover.watch("uav/safety/state"), hover.watch("uav/pose")
    old = poses.next()[0]["boot"]
    assert hover.call("goto", x=-4.5, y=0.0, z=1.0).value["accepted"]
    done = shared_lab.quadctl("reset", "--json")
    assert (done.code, done.json) == (0, {"success": True})
    fresh = poses.until(lambda p: p["boot"] != old)
    assert gap(fresh["position"], {"x": 0, "y": 0, "z": 1}) < 0.01
    dropped = states.until(lambda s: s["boot"] == fresh["boot"])
    assert dropped["state"] == "HOVERING"
    assert "restarted" in dropped["reason"]
    assert gap(dropped["goal"], {"x": 0, "y": 0, "z": 1}) < 0.1


@pytest.mark.parametrize(("key", "shown"), [("uav/info", "vehicle"), ("safety/state", "reason")])
def test_a_latched_value_is_echoed_at_once(shared_lab: Lab, key: str, shown: str):
    # The state is published once a second, info only once.
    said = shared_lab.quadctl("topic", "echo", key, "-n", 1, "--timeout", 0.5, "--json")
    assert (said.code, said.err) == (0, "")
    assert shown in said.json
