"""A vehicle that has stopped by itself, because it heard nothing, goes on only for something new."""

import signal
import time
from typing import Any

import pytest

from tests.processes.bare import Bare, Watch, gap, speed
from tests.processes.lab import Lab
from tests.processes.running import eventually

FAR, BACK = {"x": 4.5, "y": 0.0, "z": 1.0}, {"x": 0.0, "y": 0.0, "z": 1.0}


@pytest.mark.parametrize("node", ["dynamics", "safety", "hub"])
def test_a_stall_within_the_grace_pauses_the_flight(lab: Lab, node: str):
    lab.start("--set", "dynamics.start.z=1", "--set", "dynamics.grace=5",
              "--set", "supervise.answer_timeout=60")  # fmt: skip
    going = lab.spawn(*lab.command("goto", *FAR.values()))
    with lab.bare() as bare:
        poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
        poses.until(lambda p: speed(p) > 1)
        stalled = time.monotonic()
        lab.signal(node, signal.SIGSTOP)
        eventually(lambda: time.monotonic() > stalled + 0.5)
        lab.signal(node, signal.SIGCONT)
        paused = states.until(lambda s: "pause" in s["reason"])
        assert paused["state"] == ("MOVING" if node == "safety" else "HOVERING")
        states.until(lambda s: s["state"] == "MOVING" and "went on after a pause" in s["reason"])
        states.until(lambda s: s["state"] == "HOVERING" and s["goal"] == FAR)
    assert going.wait() == 0
    assert ("paused: no pose" in going.log) is (node != "safety")
    assert "arrived" in going.log


def test_safety_that_was_held_up_stops_the_flight_and_says_why(lab: Lab):
    lab.start("--set", "dynamics.start.z=1", "--set", "supervise.answer_timeout=60")
    with lab.bare() as bare:
        states, poses = bare.watch("uav/safety/state"), bare.watch("uav/pose")
        assert bare.call("goto", **FAR).value["accepted"]
        poses.until(lambda p: speed(p) > 1)
        lab.signal("safety", signal.SIGSTOP)
        place = poses.until(lambda p: speed(p) < 0.01)["position"]
        held = time.monotonic()
        eventually(lambda: time.monotonic() > held + 1.0)
        lab.signal("safety", signal.SIGCONT)
        stopped = states.until(lambda s: s["state"] == "HOVERING")
        assert "safety itself stood still for" in stopped["reason"]
        assert all(gap(p["position"], place) < 0.05 for p in poses.next(100))
        assert gap(place, FAR) > 1
    assert lab.quadctl("goto", 4.5, 0, 1).code == 0


def test_setpoints_to_the_goal_it_was_stopped_on_the_way_to_are_not_followed(lab: Lab):
    lab.start("--without", "safety", "--set", "dynamics.start.z=1")
    with lab.bare() as bare:
        poses = bare.watch("uav/pose")
        lead(bare, poses, FAR, lambda p: speed(p) > 1)
        place = poses.until(lambda p: speed(p) < 0.01)["position"]
        led = lead(bare, poses, FAR, count=100)
        assert all(gap(pose["position"], place) < 0.05 for pose in led)
        assert gap(place, FAR) > 1
        lead(bare, poses, BACK, lambda p: gap(p["position"], BACK) < 0.1)
        lead(bare, poses, FAR, lambda p: gap(p["position"], FAR) < 0.1)
    assert "hovering until another goal is asked for" in lab.log("dynamics")


def lead(bare: Bare, poses: Watch, goal: dict[str, float], until: Any = None, count: int = 1000):
    """Answer each pose with a setpoint, until one is as wanted, or so many times."""
    led = []
    for _ in range(count):
        led += poses.next()
        told = {"boot": led[-1]["boot"], "for_seq": led[-1]["seq"], "position": goal}
        bare.put("uav/input/position", {**told, "brake": False})
        if until and until(led[-1]):
            return led
    assert until is None, f"not within {count} poses; the last was {led[-1]}"
    return led


def test_without_a_grace_it_flies_and_every_silence_ends_the_flight(lab: Lab):
    lab.start("--set", "dynamics.start.z=1", "--set", "dynamics.grace=0")
    assert lab.quadctl("goto", 1, 0, 1).code == 0
    with lab.bare() as bare:
        poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
        assert bare.call("goto", **FAR).value["accepted"]
        poses.until(lambda p: speed(p) > 1)
        stalled = time.monotonic()
        lab.signal("dynamics", signal.SIGSTOP)
        eventually(lambda: time.monotonic() > stalled + 0.5)
        lab.signal("dynamics", signal.SIGCONT)
        states.until(lambda s: s["state"] == "HOVERING" and s["reason"].endswith("stopped"))
