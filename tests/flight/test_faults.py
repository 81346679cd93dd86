"""Faults to order: put in by name, shown, survived, and taken out."""

from collections.abc import Iterator

import pytest

from tests.support import telemetry
from tests.support.bare import Bare, speed
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.running import eventually

FAR = {"x": 4.5, "y": 0.0, "z": 1.0}


@pytest.fixture(scope="module")
def taught() -> Iterator[Lab]:
    """A system for faults; a machine with much else to do must not be taken for one."""
    with private_lab() as made:
        made.start("--set", "dynamics.start.z=1", *PATIENT)
        yield made


@pytest.fixture
def sound(taught: Lab) -> Iterator[Bare]:
    """It without any, hovering at its start."""
    assert taught.quadctl("fault", "clear").code == 0
    with taught.bare() as bare:
        boot = bare.state()["boot"]
        states = bare.watch("uav/safety/state")
        assert bare.call("reset").ok
        states.until(lambda s: s["boot"] != boot and s["state"] == "HOVERING")
        yield bare
    assert taught.quadctl("fault", "clear").code == 0


def test_what_is_in_is_shown_by_list_status_and_doctor(taught: Lab, sound: Bare):
    assert taught.quadctl("status", "--json").json["faults"] == []
    put = taught.quadctl("fault", "inject", "barometer-off", "--json")
    assert (put.code, put.json) == (0, {"injected": "barometer-off"})
    listed = taught.quadctl("fault", "list", "--json").json
    assert [row["name"] for row in listed if row["active"]] == ["barometer-off"]
    assert taught.quadctl("status", "--json").json["faults"] == ["uav barometer-off"]
    assert "fault: uav barometer-off" in taught.quadctl("status").out
    checks = {c["name"]: c for c in taught.quadctl("doctor", "--json", timeout=60).json["checks"]}
    assert checks["faults"]["verdict"] == "WARN"
    assert checks["faults"]["fix"].startswith("`quadctl fault clear")
    gone = taught.quadctl("fault", "clear", "--json")
    assert gone.json == {"cleared": ["barometer-off"]}
    assert taught.quadctl("fault", "clear").out == "no fault is in\n"


def test_the_one_whose_place_is_taken_is_told(taught: Lab, sound: Bare):
    for name, told in (
        ("pose-jump", ""),
        ("pose-jump", ""),
        ("gust", ""),
        ("pose-delayed", ", in the place of pose-jump"),
    ):
        assert taught.quadctl("fault", "inject", name) == (0, f"{name} is in{told}\n", "")
    assert taught.quadctl("fault", "inject", "pose-jump", "--json").json == {
        "injected": "pose-jump"
    }


@pytest.mark.parametrize("fault", ["pose-frozen", "pose-delayed", "pose-jump"])
def test_a_bad_pose_stops_a_flight_with_its_reason(taught: Lab, sound: Bare, fault: str):
    states, poses = sound.watch("uav/safety/state"), sound.watch("uav/pose")
    setpoints = sound.watch("uav/input/position")
    assert sound.call("goto", **FAR).value["accepted"]
    states.until(lambda s: s["state"] == "MOVING")
    poses.until(lambda p: speed(p) > 1)
    assert taught.quadctl("fault", "inject", fault).code == 0
    stopped = states.until(
        lambda s: s["state"] == "HOVERING" and not s["reason"].startswith("paused"), within=5
    )
    if fault != "pose-delayed":
        # What comes half a second late is old at first, and then as regular as ever.
        assert stopped["reason"]
    assert taught.quadctl("fault", "clear", fault).code == 0
    # The sound pose is the next jump: a goal accepted before safety has seen it would be stopped.
    sound_seq = poses.next(2)[-1]["seq"]
    setpoints.until(lambda s: s["for_seq"] >= sound_seq)
    flown = taught.quadctl("goto", 0, 0, 1, "--json")
    assert (flown.code, flown.json["arrived"]) == (0, True), flown


def test_weak_motors_and_gusts_are_flown_with(taught: Lab, sound: Bare):
    for fault in ("motor-weak", "gust"):
        assert taught.quadctl("fault", "inject", fault).code == 0
    assert taught.quadctl("goto", 2, 1, 1, "--json").json["arrived"]


def test_a_killed_process_and_a_cut_bus_come_back(taught: Lab, sound: Bare):
    old = taught.nodes()["pressure"]["pid"]
    assert taught.quadctl("fault", "inject", "pressure-killed").code == 0
    taught.revived("pressure", old)
    hub = taught.nodes()["hub"]["pid"]
    assert taught.quadctl("fault", "inject", "bus-cut").code == 0
    taught.revived("hub", hub)
    eventually(taught.is_ready)
    assert taught.quadctl("goto", 1, 0, 1).code == 0


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["inject", "pose-froze"], 2, "did you mean pose-frozen?"),
        (["inject", "nobody-killed"], 2, "there is no fault nobody-killed"),
        (["clear", "nonsense"], 2, "there is no fault nonsense"),
    ],
)
def test_what_is_no_fault_is_told(taught: Lab, words: list[str], code: int, said: str):
    done = taught.quadctl("fault", *words)
    assert (done.code, done.out) == (code, "")
    assert said in done.err


def test_what_would_stop_the_clock_is_refused_in_lock_step(lab: Lab):
    done = lab.quadctl("fault", "list")
    assert done.code == 3
    lab.start("--set", "dynamics.speed=0")
    refused = lab.quadctl("fault", "inject", "pose-frozen")
    assert refused.code == 6
    assert "the clock would wait for the pose for ever" in refused.err


def test_a_bus_that_is_cut_is_shown_as_that(lab: Lab):
    lab.start("--set", "supervise.answer_timeout=60")
    assert lab.quadctl("fault", "inject", "bus-cut").code == 0
    eventually(lambda: "in  bus-cut" in lab.quadctl("fault", "list").out)
    assert "fault: hub-frozen" in lab.quadctl("status").out
    assert lab.quadctl("fault", "clear", "bus-cut").out == "hub-frozen is out\n"
    assert lab.quadctl("goto", 1, 0, 1).code == 0


def test_a_frozen_process_goes_on_when_that_is_taken_out(lab: Lab):
    lab.start("--set", "supervise.answer_timeout=60", *PATIENT)
    old = lab.nodes()
    assert lab.quadctl("fault", "inject", "safety-frozen").code == 0
    eventually(lambda: "in  safety-frozen" in lab.quadctl("fault", "list").out)
    assert lab.quadctl("status", "--json").json["faults"] == ["safety-frozen"]
    assert lab.quadctl("goto", 1, 0, 1, "--timeout", 1).code == 4
    assert lab.quadctl("fault", "clear").out == "safety-frozen is out\n"
    # Of the goal asked for meanwhile the outcome is unknown: it may have been taken in time.
    assert lab.quadctl("goto", 1, 0, 1, "--replace").code == 0
    assert lab.nodes() == old


def test_repeated_pose_is_not_answered_every_time(lab: Lab):
    lab.start("--without", "dynamics", "--without", "pressure")
    with lab.bare() as bare:
        setpoints = bare.watch("uav/input/position")

        def tell(seq: int) -> None:
            bare.put("uav/pose", telemetry.pose(seq))

        tell(1)
        setpoints.until(lambda s: s["for_seq"] == 1)
        for _ in range(400):
            tell(1)
        tell(2)
        setpoints.until(lambda s: s["for_seq"] == 2)
        # It still says 20 times a second what is to be done.
        answers = [s for s in setpoints.messages if s["for_seq"] == 1]
        assert len(answers) < 200
