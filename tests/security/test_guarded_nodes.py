"""Guarded run: what the node of a stranger may do on the bus, seen from a session with its password."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from tests.support.bare import Bare, pack, ticket
from tests.support.lab import Lab
from tests.support.running import eventually

GUARDED = """
import sys, time
from quadctl.cli.temporary_run import temporary_run
from quadctl.schemas.params import Params
from quadctl.services.runtime.supervisor.launch import Launch
words = [sys.executable, "-P", "-m", "quadctl.services.safety"]
params = Params(processes={"safety": words})
with temporary_run(Launch(sys.argv[1], {"uav": params}, [], sys.argv[2], guarded=True)):
    print("up", flush=True)
    time.sleep(1000)
"""
"""Program that runs our safety as if a student had handed it in."""
FORBIDDEN = (
    "uav/pose",
    "uav/pose/slow",
    "uav/*",
    "uav/**",
    "uav/sensors/pressure",
    "uav/@call/reset",
)


def session(lab: Lab, name: str) -> Bare:
    address = json.loads((lab.home / name).read_bytes())
    return Bare(address["endpoint"], address["user"], address["password"])


@pytest.fixture
def both(lab: Lab) -> Iterator[tuple[Bare, Bare]]:
    """Sessions with the rights of our own processes, and of the node."""
    run = lab.spawn(sys.executable, "-c", GUARDED, lab.realm, str(lab.folder))
    eventually(lambda: run.log == "up\n", describe=lambda: run.log)
    try:
        with session(lab, "hub.json") as ours, session(lab, "safety.hub.json") as its:
            yield ours, its
    finally:
        run.end()


@pytest.mark.thorough
def test_a_guarded_node_does_what_its_name_stands_for(both: tuple[Bare, Bare], lab: Lab):
    ours, its = both
    flown = ours.fly(1.0, 0.0, 1.0)  # by a safety that is guarded
    assert flown["state"] == "HOVERING"
    seen = {key: ours.watch(key) for key in (*FORBIDDEN[:2], "uav/input/position", "uav/own/x")}
    before = ours.call("dynamics/get_params", names=[]).value["values"]
    for service, fields in {
        "dynamics/set_params": {"values": {"dynamics.fault.pose": "jump"}},
        "reset": {},
        "goto": {"x": 0.0, "y": 0.0, "z": 1.0},
    }.items():
        call = its.answers(f"uav/@srv/{service}", pack(fields), attachment=ticket(2.0), timeout=2.0)
        assert call == [], service
    for key in FORBIDDEN:
        its.put(key, {"forged": True})
    for key in ("uav/input/position", "uav/own/x"):
        its.put(key, {"forged": True})
    its.session.delete("uav/pose")
    token = its.session.liveliness().declare_token("uav/@node/gate")
    answers = its.session.declare_queryable("uav/@srv/reset", lambda query: query.drop())
    for key in ("uav/input/position", "uav/own/x"):
        seen[key].until(lambda message: "forged" in message)
    its_poses = its.watch("uav/pose")
    assert its_poses.next(20)
    assert not [m for key in FORBIDDEN[:2] for m in seen[key].messages if "forged" in m]
    assert its.call("dynamics/get_params", names=[]).value["values"] == before
    assert "gate" not in ours.nodes()
    assert ours.call("reset").ok
    token.undeclare()
    answers.undeclare()


@pytest.mark.thorough
def test_its_folder_is_that_of_its_command_alone(both: tuple[Bare, Bare], lab: Lab):
    folders = {
        name: str(Path(f"/proc/{node['pid']}/cwd").readlink()) for name, node in lab.nodes().items()
    }
    assert folders == dict.fromkeys(folders, "/") | {"safety": str(lab.folder)}


@pytest.mark.thorough
def test_without_its_password_nobody_is_let_in(both: tuple[Bare, Bare], lab: Lab):
    endpoint = f"unixsock-stream/{lab.home / 'hub.sock'}"
    for user, password in (("", ""), ("safety", "guess"), ("dynamics", "")):
        with pytest.raises(zenoh.ZError):
            Bare(endpoint, user, password)
