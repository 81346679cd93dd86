"""Fault injection: faults are injected by name, shown, survived and cleared."""

from collections.abc import Iterator

import pytest

from quadctl.cli.fault.catalogue import FAULTS
from tests.support import telemetry
from tests.support.bare import Bare, speed
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.running import eventually

FAR = {"x": 4.5, "y": 0.0, "z": 1.0}


@pytest.fixture(scope="module")
def faulty() -> Iterator[Lab]:
    """System for fault injection on a busy machine: its timeouts are long, and its flights slow.

    The command that injects a fault must end before the flight does.
    """
    slow = "--set", "dynamics.control.max_speed=0.4"
    with private_lab() as made:
        made.share("--set", "dynamics.start.z=1", *slow, *PATIENT)
        yield made


@pytest.fixture
def healthy(faulty: Lab) -> Iterator[Bare]:
    """Session on that system without any fault, the vehicle hovering at its start."""
    assert faulty.quadctl("fault", "clear").code == 0
    with faulty.put_back_session() as bare:
        yield bare


@pytest.mark.thorough
def test_list_status_and_doctor_show_an_injected_fault(faulty: Lab, healthy: Bare):
    assert faulty.quadctl("status", "--json").json["faults"] == []
    put = faulty.quadctl("fault", "inject", "barometer-off", "--json")
    assert (put.code, put.json) == (0, {"injected": "barometer-off"})
    listed = faulty.quadctl("fault", "list", "--json").json
    assert [row["name"] for row in listed if row["active"]] == ["barometer-off"]
    assert faulty.quadctl("status", "--json").json["faults"] == ["uav barometer-off"]
    assert "fault: uav barometer-off" in faulty.quadctl("status").out
    checks = {c["name"]: c for c in faulty.quadctl("doctor", "--json").json["checks"]}
    assert checks["faults"]["verdict"] == "WARN"
    assert checks["faults"]["fix"].startswith("`quadctl fault clear")
    gone = faulty.quadctl("fault", "clear", "--json")
    assert gone.json == {"cleared": ["barometer-off"]}
    assert faulty.quadctl("fault", "clear").out == "no fault is in\n"


def test_a_fault_takes_its_size_in_one_command_and_loses_it_when_cleared(
    faulty: Lab, healthy: Bare
):
    names = ("pressure.fault", "dynamics.fault")
    before = faulty.quadctl("param", "get", *names).out
    for line, name, value in (
        ("barometer-glitch 5", "pressure.fault.magnitude", "5.0"),
        ("pose-jump -.5", "dynamics.fault.jump", "-0.5"),
        ("motor-weak 0.8", "dynamics.fault.motors", "0.8"),
    ):
        done = faulty.quadctl("fault", "inject", *line.split())
        assert done == (0, f"{line.partition(' ')[0]} is in\n", "")
        assert faulty.quadctl("param", "get", name).out == f"{value}\n"
    assert faulty.quadctl("fault", "clear").code == 0
    assert faulty.quadctl("param", "get", *names).out == before
    # One fault in place of another, and one that a parameter took out.
    assert faulty.quadctl("fault", "inject", "pose-jump", "0.2").code == 0
    replaced = faulty.quadctl("fault", "inject", "pose-delayed", "0.1")
    assert replaced.out == "pose-delayed is in, in place of pose-jump\n"
    assert faulty.quadctl("param", "get", "dynamics.fault.jump").out == "3.0\n"
    assert faulty.quadctl("param", "set", "dynamics.fault.pose", "none").code == 0
    assert faulty.quadctl("fault", "clear").out == "no fault is in\n"
    assert faulty.quadctl("param", "get", *names).out == before
    for line, code, what in (
        ("barometer-stuck 5", 2, "barometer-stuck has no size"),
        ("safety-killed 5", 2, "safety-killed has no size"),
        ("motor-weak 1", 6, "is no fault"),
        ("barometer-glitch 1e9", 6, "<= 100"),
        ("barometer-glitch five", 2, "five"),
        ("safety-killed --vehicle zzz", 3, "this run has no vehicle zzz"),
    ):
        refused = faulty.quadctl("fault", "inject", *line.split())
        assert (refused.code, what in refused.err) == (code, True), refused
    assert faulty.quadctl("param", "get", *names).out == before


@pytest.mark.thorough
def test_every_fault_of_the_table_is_injected_shown_and_cleared(faulty: Lab, healthy: Bare):
    for fault in FAULTS:
        assert faulty.quadctl("fault", "inject", fault.name).code == 0
        assert faulty.quadctl("status", "--json").json["faults"] == [f"uav {fault.name}"]
        assert faulty.quadctl("param", "get", fault.parameter).out == f"{fault.value}\n"
        assert faulty.quadctl("fault", "clear", "--json").json == {"cleared": [fault.name]}
        assert faulty.quadctl("param", "get", fault.parameter).out == f"{fault.sound}\n"


@pytest.mark.thorough
def test_inject_names_the_fault_that_it_replaces(faulty: Lab, healthy: Bare):
    for name, told in (
        ("pose-jump", ""),
        ("pose-jump", ""),
        ("gust", ""),
        ("pose-delayed", ", in place of pose-jump"),
    ):
        assert faulty.quadctl("fault", "inject", name) == (0, f"{name} is in{told}\n", "")
    assert faulty.quadctl("fault", "inject", "pose-jump", "--json").json == {
        "injected": "pose-jump"
    }


@pytest.mark.parametrize(
    "fault",
    ["pose-frozen", pytest.param("pose-delayed", marks=pytest.mark.thorough), "pose-jump"],
)
def test_a_bad_pose_stops_a_flight_with_its_reason(faulty: Lab, healthy: Bare, fault: str):
    states, poses = healthy.watch("uav/safety/state"), healthy.watch("uav/pose")
    setpoints = healthy.watch("uav/input/position")
    assert healthy.call("goto", **FAR).value["accepted"]
    states.until(lambda s: s["state"] == "MOVING")
    poses.until(lambda p: speed(p) > 0.2)
    assert faulty.quadctl("fault", "inject", fault).code == 0
    stopped = states.until(
        lambda s: s["state"] == "HOVERING" and not s["reason"].startswith("paused")
    )
    if fault != "pose-delayed":
        # Poses half a second late are old at first, but then arrive as regularly as before.
        assert stopped["reason"]
    assert faulty.quadctl("fault", "clear", fault).code == 0
    # The first sound pose is a jump too: it would stop a goal accepted before safety has seen it.
    sound_seq = poses.next(2)[-1]["seq"]
    setpoints.until(lambda s: s["for_seq"] >= sound_seq)
    flown = faulty.quadctl("goto", 0, 0, 1, "--json")
    assert (flown.code, flown.json["arrived"]) == (0, True), flown


@pytest.mark.thorough
def test_a_vehicle_arrives_with_weak_motors_and_gusts(faulty: Lab, healthy: Bare):
    for fault in ("motor-weak", "gust"):
        assert faulty.quadctl("fault", "inject", fault).code == 0
    assert faulty.quadctl("goto", 2, 1, 1, "--json").json["arrived"]


@pytest.mark.thorough
def test_a_killed_process_and_a_cut_bus_recover(faulty: Lab, healthy: Bare):
    old = faulty.nodes()["pressure"]["pid"]
    assert faulty.quadctl("fault", "inject", "pressure-killed").code == 0
    faulty.revived("pressure", old)
    hub = faulty.nodes()["hub"]["pid"]
    assert faulty.quadctl("fault", "inject", "bus-cut").code == 0
    faulty.revived("hub", hub)
    eventually(faulty.is_ready)
    assert faulty.quadctl("goto", 1, 0, 1).code == 0


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["inject", "pose-froze"], 2, "did you mean pose-frozen?"),
        (["inject", "nobody-killed"], 2, "there is no fault nobody-killed"),
        (["clear", "nonsense"], 2, "there is no fault nonsense"),
    ],
)
def test_an_unknown_fault_is_refused_with_the_nearest_name(
    faulty: Lab, words: list[str], code: int, said: str
):
    done = faulty.quadctl("fault", *words)
    assert (done.code, done.out) == (code, "")
    assert said in done.err


@pytest.mark.thorough
def test_a_fault_that_would_stop_the_clock_is_refused_in_lock_step(lab: Lab):
    done = lab.quadctl("fault", "list")
    assert done.code == 3
    lab.start("--set", "dynamics.speed=0")
    refused = lab.quadctl("fault", "inject", "pose-frozen")
    assert refused.code == 6
    assert "the clock would wait for the pose for ever" in refused.err


@pytest.mark.thorough
def test_a_cut_bus_is_shown_as_bus_cut(lab: Lab):
    lab.start("--set", "supervise.answer_timeout=60")
    assert lab.quadctl("fault", "inject", "bus-cut").code == 0
    eventually(lambda: "in  bus-cut" in lab.quadctl("fault", "list").out)
    assert "fault: hub-frozen" in lab.quadctl("status").out
    assert lab.quadctl("fault", "clear", "bus-cut").out == "hub-frozen is out\n"
    assert lab.quadctl("goto", 1, 0, 1).code == 0


@pytest.mark.thorough
def test_a_frozen_process_goes_on_when_the_fault_is_cleared(lab: Lab):
    lab.start("--set", "supervise.answer_timeout=60", *PATIENT)
    old = lab.nodes()
    assert lab.quadctl("fault", "inject", "safety-frozen").code == 0
    eventually(lambda: "in  safety-frozen" in lab.quadctl("fault", "list").out)
    assert lab.quadctl("status", "--json").json["faults"] == ["safety-frozen"]
    assert lab.quadctl("goto", 1, 0, 1, "--timeout", 1).code == 4
    assert lab.quadctl("fault", "clear").out == "safety-frozen is out\n"
    # A goal that is accepted before safety has seen a new pose is stopped for the silence before it.
    with lab.bare() as bare:
        poses, setpoints = bare.watch("uav/pose"), bare.watch("uav/input/position")
        newest = poses.next()[0]["seq"]
        setpoints.until(lambda s: s["for_seq"] >= newest)
    # The outcome of the goal sent during the freeze is unknown: it may have been accepted in time.
    assert lab.quadctl("goto", 1, 0, 1, "--replace").code == 0
    assert lab.nodes() == old


@pytest.mark.thorough
def test_a_repeated_pose_is_not_answered_every_time(lab: Lab):
    lab.start("--without", "dynamics", "--without", "pressure")
    with lab.bare() as bare:
        setpoints = bare.watch("uav/input/position")

        def publish_pose(seq: int) -> None:
            bare.put("uav/pose/slow", telemetry.pose(seq))

        publish_pose(1)
        setpoints.until(lambda s: s["for_seq"] == 1)
        for _ in range(400):
            publish_pose(1)
        publish_pose(2)
        setpoints.until(lambda s: s["for_seq"] == 2)
        # Safety still publishes 20 setpoints a second.
        answers = [s for s in setpoints.messages if s["for_seq"] == 1]
        assert len(answers) < 200
