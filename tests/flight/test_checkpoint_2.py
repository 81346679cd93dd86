"""Checkpoint 2: goals inside the cage are reached; goals outside are refused and change nothing."""

import re

import pytest

from tests.support.bare import Bare, gap, speed
from tests.support.lab import PATIENT, QUADCTL, Lab
from tests.support.running import eventually

GOAL = {"x": 1.0, "y": 2.0, "z": 1.0}
FAR = (-4.5, -4.5, 4.0)


def test_a_goal_inside_is_reached(shared_lab: Lab, hover: Bare):
    flown = shared_lab.quadctl("goto", 1, 2, 1)
    assert flown.code == 0
    assert flown.err == ""
    accepted, arrived = flown.out.splitlines()
    assert accepted == "accepted"
    assert re.fullmatch(r"arrived within 0\.\d\d m after \d+\.\d\d s", arrived)
    pose = hover.watch("uav/pose").until(lambda p: gap(p["position"], GOAL) < 0.05)
    assert gap(pose["position"], GOAL) < 0.05


@pytest.mark.parametrize(
    ("goal", "axis", "bound"),
    [((9, 0, 1), "x", "[-5, 5]"), ((0, -5.01, 1), "y", "[-5, 5]"), ((0, 0, -0.1), "z", "[0, 5]")],
)
def test_a_goal_outside_is_refused_and_nothing_moves(
    shared_lab: Lab, hover: Bare, goal: tuple[float, ...], axis: str, bound: str
):
    poses, setpoints = hover.watch("uav/pose"), hover.watch("uav/input/position")
    before, setpoint = poses.next()[0], setpoints.next()[0]
    refused = shared_lab.quadctl("goto", *goal)
    assert refused.code == 5
    assert refused.out == "rejected\n"
    assert f"{axis} = " in refused.err
    assert bound in refused.err
    setpoints.next(10)
    # Only `for_seq` keeps counting.
    assert {str(s["position"]) for s in setpoints.messages} == {str(setpoint["position"])}
    assert {s["brake"] for s in setpoints.messages} == {setpoint["brake"]}
    moved = max(gap(pose["position"], before["position"]) for pose in poses.messages)
    assert moved < 0.05
    assert hover.state()["state"] == "HOVERING"


def test_a_goal_on_the_boundary_is_inside_the_cage(hover: Bare):
    assert hover.call("goto", x=5.0, y=0.0, z=1.0).value["accepted"]
    assert not hover.call("goto", x=5.000000000000001, y=0.0, z=1.0, replace=True).value["accepted"]


def test_a_goal_while_moving_is_busy_until_replaced(shared_lab: Lab, hover: Bare):
    states = hover.watch("uav/safety/state")
    assert shared_lab.quadctl("goto", *FAR, "--no-wait", "--json").json["accepted"]
    busy = hover.call("goto", x=1.0, y=0.0, z=1.0).value
    assert not busy["accepted"]
    assert "busy" in busy["reason"]
    assert "-4.5" in busy["reason"]
    assert hover.state()["goal"] == dict(zip("xyz", FAR, strict=True))
    assert hover.call("goto", x=1.0, y=0.0, z=1.0, replace=True).value["accepted"]
    near = {"x": 1.0, "y": 0.0, "z": 1.0}
    assert states.until(lambda s: s["goal"] == near)["state"] == "MOVING"
    assert states.until(lambda s: s["state"] == "HOVERING")["goal"] == near


def test_the_first_goal_is_accepted_the_next_busy_until_replaced(lab: Lab):
    # Slow, so that the first flight still lasts at the second command, on any machine.
    lab.start("--set", "dynamics.control.max_speed=0.5", *PATIENT)
    # The first command after the start is accepted even during the take-off.
    assert lab.quadctl("goto", *FAR, "--no-wait").code == 0
    busy = lab.quadctl("goto", 1, 0, 1)
    assert busy.code == 5
    assert "busy" in busy.err
    taken = lab.quadctl("goto", 0, 0, 0.5, "--replace", "--json")
    assert taken.code == 0
    assert taken.json["arrived"]


def test_no_wait_returns_before_the_arrival(shared_lab: Lab, hover: Bare):
    done = shared_lab.quadctl("goto", *FAR, "--no-wait", "--json")
    assert done.code == 0
    assert done.json["accepted"]
    assert not done.json["arrived"]
    assert hover.state()["state"] == "MOVING"


def test_an_arrival_timeout_exits_4_and_the_flight_goes_on(shared_lab: Lab, hover: Bare):
    late = shared_lab.quadctl("goto", *FAR, "--arrive", 0.2, "--json")
    assert late.code == 4
    assert late.json["accepted"]
    assert not late.json["arrived"]
    assert late.error["code"] == "timeout"
    now = hover.state()
    assert (now["state"], now["reason"]) == ("MOVING", "")


def test_hold_ends_a_waiting_goto_and_the_vehicle_stays_there(shared_lab: Lab, hover: Bare):
    poses, states = hover.watch("uav/pose"), hover.watch("uav/safety/state")
    # So slow that the flight lasts longer than the start of a command on a busy machine.
    slow = {"dynamics.control.max_speed": 1.0}
    assert hover.call("dynamics/set_params", values=slow).value["success"]
    # A vehicle that still moves from its start takes a limit over when it rests.
    eventually(lambda: "in_force" not in hover.call("dynamics/get_params", names=[*slow]).value)
    waiting = shared_lab.spawn(*QUADCTL, "goto", "-4.5", "-4.5", "4")
    poses.until(lambda p: speed(p) > 0.9)
    asked_at = poses.messages[-1]["position"]
    held = shared_lab.quadctl("hold", "--json")
    assert (held.code, held.json) == (0, {"success": True})
    assert waiting.wait() == 5
    assert "hold" in waiting.log
    poses.until(lambda p: speed(p) < 0.02)
    rest = poses.next()[0]["position"]
    assert gap(rest, dict(zip("xyz", FAR, strict=True))) > 0.5
    # It braked ahead of the point of the hold, and moved neither back nor on afterwards.
    assert gap(rest, asked_at) > 0.05
    assert max(gap(pose["position"], rest) for pose in poses.next(100)) < 0.05
    end = states.until(lambda s: gap(s["goal"], rest) < 0.1)
    assert end["state"] == "HOVERING"
    assert "hold" in end["reason"]


def test_a_goal_is_accepted_as_soon_as_safety_is_ready(lab: Lab):
    lab.spawn(*QUADCTL, "up")
    with lab.first_bare() as bare:
        eventually(lambda: "safety" in bare.nodes())
        # The take-off is still under way, and is replaced.
        assert bare.call("goto", **GOAL).value == {"accepted": True, "reason": ""}
        assert bare.state()["goal"] == GOAL
    eventually(lab.is_ready)


def test_settle_waits_until_the_vehicle_rests(shared_lab: Lab, hover: Bare):
    done = shared_lab.quadctl("goto", 1, 1, 1, "--settle")
    assert done.code == 0, done.err
    (distance,) = re.findall(r"^rests within ([\d.]+) m after [\d.]+ s$", done.out, re.MULTILINE)
    assert float(distance) <= 0.02
    refused = shared_lab.quadctl("goto", 0, 0, 1, "--settle", "--no-wait")
    assert refused.code == 2
    assert "--settle goes not with --no-wait" in refused.err
