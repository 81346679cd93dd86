"""A process that dies or freezes in flight comes back by itself, and the lab goes on with it."""

import signal
from collections.abc import Iterator

import pytest

from tests.processes.bare import Bare, gap, speed
from tests.processes.lab import NODES, Lab, private_lab
from tests.processes.running import eventually

GOAL = {"x": 7.0, "y": 0.0, "z": 1.0}


@pytest.fixture(scope="module")
def roomy() -> Iterator[Lab]:
    """A lab with room for a flight long enough to kill something in the middle of it."""
    with private_lab() as made:
        made.start("--set", "safety.virtual_cage.x=9", "--set", "dynamics.start.z=1")
        yield made


@pytest.fixture
def flight(roomy: Lab) -> Iterator[Bare]:
    """The vehicle under way from the start to the goal, cage off and barometer zeroed."""
    with roomy.bare() as bare:
        poses = bare.watch("uav/pose")
        boot = poses.next()[0]["boot"]
        assert bare.call("reset").ok
        poses.until(lambda p: p["boot"] != boot)
        eventually(lambda: bare.state()["boot"] not in {"", boot})
        assert bare.call("calibrate_pressure", zero=True).ok
        assert bare.call("toggle_cage", cage_on=False).ok
        assert bare.call("goto", **GOAL).value["accepted"]
        poses.until(lambda p: speed(p) > 1)
        assert bare.state()["state"] == "MOVING"
        yield bare


@pytest.mark.parametrize("node", NODES)
def test_killed_in_flight_a_node_comes_back_and_the_same_goal_is_flown(
    roomy: Lab, flight: Bare, node: str
):
    before = roomy.nodes()
    old = roomy.signal(node, signal.SIGKILL)
    roomy.revived(node, old)
    after = roomy.nodes()
    restarts = {name: after[name]["restarts"] - before[name]["restarts"] for name in NODES}
    assert restarts == {name: int(name == node) for name in NODES}

    # A new session, because the hub may be a new one; nothing but ready was waited for.
    with roomy.bare() as bare:
        poses = bare.watch("uav/pose")
        assert (poses.next()[0]["position"]["x"] < GOAL["x"] - 0.5) or node == "pressure"
        state = bare.state()
        if node == "safety":
            assert state["cage_on"]
            assert "restarted" in state["reason"]
        if node == "pressure":
            assert bare.watch("uav/sensors/pressure").next()[0]["baseline"] == 0
        flown = roomy.quadctl("goto", 7, 0, 1, "--replace", "--json")
        assert (flown.code, flown.json["arrived"]) == (0, True)
        poses.until(lambda p: gap(p["position"], GOAL) < 0.1)
        calibrated = bare.call("calibrate_pressure", zero=True)
        assert calibrated.value["baseline"] == pytest.approx(1013.13, abs=0.05)
        readings = bare.watch("uav/sensors/pressure")
        zeroed = readings.until(lambda r: r["baseline"] == calibrated.value["baseline"])
        assert abs(zeroed["pressure"]) < 0.02


def test_frozen_nodes_are_killed_and_restarted(roomy: Lab, flight: Bare):
    frozen = {node: roomy.signal(node, signal.SIGSTOP) for node in ("safety", "pressure")}
    # Without setpoints the vehicle brakes long before the freeze is noticed by its silence.
    poses = flight.watch("uav/pose")
    rest = poses.until(lambda p: speed(p) < 0.02)
    assert rest["position"]["x"] < GOAL["x"] - 0.5
    for node, old in frozen.items():
        roomy.revived(node, old)
    log = (roomy.home / "logs" / "up.log").read_text(encoding="utf-8")
    for node in frozen:
        assert f"{node}: no answer for 2 s: killed" in log
    assert flight.call("goto", **GOAL).value["accepted"]


def test_a_node_that_always_dies_fails_the_start_with_its_last_words(lab: Lab):
    lab.file(
        '[processes]\nsafety = "python -c \'raise SystemExit(\\"no wings\\")\'"\n', "quad.toml"
    )
    failed = lab.quadctl("up", "-d", "--json")
    assert (failed.code, failed.out) == (1, "")
    assert "safety does not stay up" in failed.error["message"]
    assert "no wings" in failed.error["message"]
    assert not lab.home.exists()


def test_a_command_given_while_the_hub_is_being_restarted_waits_for_it(roomy: Lab):
    eventually(lambda: all(node["state"] == "ready" for node in roomy.nodes().values()))
    roomy.signal("hub", signal.SIGKILL)
    assert roomy.quadctl("topic", "echo", "pose", "-n", "1").code == 0
