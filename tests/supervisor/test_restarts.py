"""A process that dies or freezes in flight is restarted, and the lab goes on."""

import os
import signal
import time
from collections.abc import Iterator

import pytest

from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.supervisor import control
from tests.support.bare import Bare, gap, speed
from tests.support.lab import NODES, PATIENT, Lab, private_lab
from tests.support.running import eventually

GOAL = {"x": 7.0, "y": 0.0, "z": 1.0}


@pytest.fixture(scope="module")
def wide_cage() -> Iterator[Lab]:
    """Lab with a cage so wide that a process can be killed in the middle of a flight."""
    with private_lab() as made:
        made.start("--set", "safety.virtual_cage.x=9", "--set", "dynamics.start.z=1", *PATIENT)
        yield made


@pytest.fixture
def flight(wide_cage: Lab) -> Iterator[Bare]:
    """Vehicle in flight from the start to the goal, cage off and barometer zeroed."""
    with wide_cage.bare() as bare:
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


@pytest.mark.thorough
@pytest.mark.parametrize("node", NODES)
def test_a_node_killed_in_flight_restarts_and_the_goal_is_flown(
    wide_cage: Lab, flight: Bare, node: str
):
    before = wide_cage.nodes()
    old = wide_cage.signal(node, signal.SIGKILL)
    wide_cage.revived(node, old)
    after = wide_cage.nodes()
    restarts = {name: after[name]["restarts"] - before[name]["restarts"] for name in NODES}
    assert restarts == {name: int(name == node) for name in NODES}

    # A new session, because the hub may be a new one. Until here only `ready` was awaited.
    with wide_cage.bare() as bare:
        poses = bare.watch("uav/pose")
        # Without setpoints or poses it stands; after a short silence of the hub it has gone on.
        stands = poses.next()[0]["position"]["x"] < GOAL["x"] - 0.5
        assert stands or node in {"pressure", "hub"}
        state = bare.state()
        if node == "safety":
            assert state["cage_on"]
            assert "restarted" in state["reason"]
        if node == "pressure":
            assert bare.watch("uav/sensors/pressure").next()[0]["baseline"] == 0
        flown = wide_cage.quadctl("goto", 7, 0, 1, "--replace", "--json")
        assert (flown.code, flown.json["arrived"]) == (0, True)
        poses.until(lambda p: gap(p["position"], GOAL) < 0.1)
        calibrated = bare.call("calibrate_pressure", zero=True)
        assert calibrated.value["baseline"] == pytest.approx(1013.13, abs=0.05)
        readings = bare.watch("uav/sensors/pressure")
        zeroed = readings.until(lambda r: r["baseline"] == calibrated.value["baseline"])
        assert abs(zeroed["pressure"]) < 0.02


@pytest.mark.thorough
def test_a_waiting_goto_names_the_restart_of_safety_as_the_reason(wide_cage: Lab, flight: Bare):
    old = wide_cage.nodes()["safety"]["pid"]
    waiting = wide_cage.spawn(*wide_cage.command("goto", -7, 0, 1, "--replace"))
    eventually(lambda: "accepted" in waiting.log)
    wide_cage.signal("safety", signal.SIGKILL)
    assert waiting.wait() == 5, waiting.log
    assert "the flight was stopped: safety restarted: hovering here, cage on" in waiting.log
    wide_cage.revived("safety", old)


def test_frozen_nodes_are_killed_and_restarted(wide_cage: Lab, flight: Bare):
    frozen = {node: wide_cage.signal(node, signal.SIGSTOP) for node in ("safety", "pressure")}
    # Without setpoints the vehicle brakes long before the supervisor detects the freeze.
    poses = flight.watch("uav/pose")
    rest = poses.until(lambda p: speed(p) < 0.02)
    assert rest["position"]["x"] < GOAL["x"] - 0.5
    for node, old in frozen.items():
        wide_cage.revived(node, old)
    log = (wide_cage.home / "logs" / "up.log").read_text(encoding="utf-8")
    for node in frozen:
        assert f"{node}: no answer for 2 s: killed" in log
    assert flight.call("goto", **GOAL).value["accepted"]


@pytest.mark.thorough
def test_a_node_that_freezes_when_ready_is_killed_and_restarted(wide_cage: Lab):
    wide_cage.revived("pressure", wide_cage.signal("pressure", signal.SIGKILL))
    wide_cage.revived("pressure", wide_cage.signal("pressure", signal.SIGSTOP))


@pytest.mark.thorough
def test_a_node_that_always_dies_fails_the_start_with_its_output(lab: Lab):
    lab.file(
        '[processes]\nsafety = "python -c \'raise SystemExit(\\"no wings\\")\'"\n', "quad.toml"
    )
    failed = lab.quadctl("up", "-d", "--json")
    assert (failed.code, failed.out) == (1, "")
    assert "safety does not stay up" in failed.error["message"]
    assert failed.error["message"].count("no wings") == 1, "of its attempts the last one"
    assert str(lab.home / "logs") in failed.error["hint"]
    assert lab.quadctl("node", "logs", "safety").out.count("no wings") > 1
    assert lab.taken_logs()["safety.log"].count("no wings") > 1


@pytest.mark.thorough
def test_a_stopped_supervisor_counts_no_node_as_frozen(wide_cage: Lab):
    before = wide_cage.nodes()
    supervisor = wide_cage.status()["pid"]
    os.kill(supervisor, signal.SIGSTOP)
    try:
        time.sleep(3.0)  # longer than a node may be silent
    finally:
        os.kill(supervisor, signal.SIGCONT)
    # After it has restarted one node it has checked all of them again.
    wide_cage.revived("pressure", wide_cage.signal("pressure", signal.SIGKILL))
    after = wide_cage.nodes()
    restarts = {name: after[name]["restarts"] - before[name]["restarts"] for name in NODES}
    assert restarts == {name: int(name == "pressure") for name in NODES}


@pytest.mark.thorough
def test_echo_names_the_dead_node_when_its_topic_falls_silent(wide_cage: Lab):
    eventually(wide_cage.is_ready)
    supervisor, old = wide_cage.status()["pid"], wide_cage.nodes()["dynamics"]["pid"]
    heard = wide_cage.spawn(*wide_cage.command("topic", "echo", "pose", "--timeout", 1))
    eventually(lambda: "---" in heard.log)
    # A stopped supervisor does not restart it.
    os.kill(supervisor, signal.SIGSTOP)
    try:
        wide_cage.signal("dynamics", signal.SIGKILL)
        assert heard.wait() == 3
    finally:
        os.kill(supervisor, signal.SIGCONT)
    assert "nothing more came on uav/pose within 1 s: dynamics is gone" in heard.log
    wide_cage.revived("dynamics", old)


def test_a_command_during_a_hub_restart_waits_for_the_hub(wide_cage: Lab):
    eventually(lambda: all(node["state"] == "ready" for node in wide_cage.nodes().values()))
    wide_cage.signal("hub", signal.SIGKILL)
    assert wide_cage.quadctl("topic", "echo", "pose", "-n", 1, "--timeout", 20).code == 0


@pytest.mark.thorough
def test_a_requested_restart_works_in_any_state_of_the_process(wide_cage: Lab):
    realm = realm_of(wide_cage)
    for node, prepare in (("pressure", None), ("hub", signal.SIGSTOP), ("safety", signal.SIGSTOP)):
        eventually(wide_cage.is_ready)
        if prepare is not None:
            wide_cage.signal(node, prepare)
        before = control.request_restart(realm, node)
        after = control.wait_restarted(realm, node, before, 10.0)
        assert after.restarts == before.restarts + 1
        assert after.started > before.started > 1e9
    log = (wide_cage.home / "logs" / "up.log").read_text(encoding="utf-8")
    assert log.count(": restart requested\n") == 3
    assert "pressure ended" not in log.rpartition("pressure: restart requested")[2]


def realm_of(lab: Lab) -> Realm:
    """Return the lab's realm for calls from the test's own process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(lab.runtime))
        return Realm(lab.realm)


@pytest.mark.thorough
def test_a_node_left_down_starts_again_on_request(lab: Lab):
    command = "shy = ['sh', '-c', '[ -e here ] || exit 3; exec sleep 99']"
    lab.spawn(*lab.command("up", lab.file(f"[processes]\n{command}\n")))
    eventually(lambda: lab.nodes().get("shy", {"state": ""})["state"] == "down")
    realm = realm_of(lab)
    with pytest.raises(QuadctlError, match="does not stay up"):
        control.wait_restarted(realm, "shy", control.request_restart(realm, "shy"), 10.0)
    (lab.folder / "here").touch()
    before = control.request_restart(realm, "shy")
    after = control.wait_restarted(realm, "shy", before, 10.0)
    assert (before.pid, before.state, after.state) == (0, "down", "ready")
    assert after.restarts == before.restarts + 1


@pytest.mark.thorough
def test_a_node_whose_name_is_taken_returns_when_the_name_is_free(wide_cage: Lab):
    eventually(wide_cage.is_ready)
    with wide_cage.bare() as stranger:
        token = stranger.session.liveliness().declare_token("uav/@node/pressure")
        before = wide_cage.nodes()["pressure"]["restarts"]
        wide_cage.signal("pressure", signal.SIGKILL)
        # More restarts than quick deaths are allowed.
        eventually(lambda: wide_cage.nodes()["pressure"]["restarts"] >= before + 6)
        assert wide_cage.nodes()["pressure"]["state"] != "down"
        token.undeclare()
    wide_cage.revived("pressure", 0)
    log = (wide_cage.home / "logs" / "up.log").read_text(encoding="utf-8")
    assert log.count("pressure ended (exit 7): another process has its name") == 1
    told = (wide_cage.home / "logs" / "pressure.log").read_text(encoding="utf-8")
    assert told.count("another process is already the node pressure") == 1


@pytest.mark.thorough
def test_a_killed_hub_without_other_nodes_is_restarted(lab: Lab):
    lab.start("--without", "dynamics", "--without", "pressure", "--without", "safety")
    lab.revived("hub", lab.signal("hub", signal.SIGKILL))
    assert lab.nodes()["hub"]["restarts"] == 1
