"""Output of commands: with --json one document and nothing else, without it plain lines."""

from typing import Any

import pytest

from tests.support.bare import Bare
from tests.support.lab import NODES, Lab
from tests.support.running import eventually

STATE_FIELDS = {
    "boot", "stamp", "request", "state", "goal", "cage_on", "cage", "reason", "pose",
}  # fmt: skip


def ask(lab: Lab, *words: object) -> Any:
    done = lab.quadctl(*words, "--json")
    assert (done.code, done.err) == (0, "")
    return done.json


@pytest.mark.parametrize("name", ["status", "ps"])
def test_status_prints_the_realm_and_its_nodes(shared_lab: Lab, name: str):
    said = ask(shared_lab, name)
    assert said.pop("faults") == []
    assert said == shared_lab.status()
    assert said["realm"] == shared_lab.realm
    assert [node["name"] for node in said["nodes"]] == NODES
    for node in said["nodes"]:
        assert set(node) >= {"name", "pid", "state", "restarts"}
        assert node["state"] == "ready"


def test_node_list_prints_topics_and_services(shared_lab: Lab):
    nodes = {node["name"]: node for node in ask(shared_lab, "node", "list")}
    assert list(nodes) == NODES
    assert nodes["dynamics"]["topics"] == ["uav/pose", "uav/pose/slow"]
    assert any(service.endswith("toggle_cage") for service in nodes["safety"]["services"])


def test_topic_and_service_list_print_types_and_rates(shared_lab: Lab):
    topics = {topic["key"]: topic for topic in ask(shared_lab, "topic", "list")}
    rates = {key: (t["type"], t["node"], t["declared_hz"]) for key, t in topics.items()}
    assert rates["uav/pose"] == ("Pose", "dynamics", 100)
    assert rates["uav/sensors/pressure"] == ("Pressure", "pressure", 10)
    assert rates["uav/input/position"] == ("Setpoint", "safety", 20)
    assert "uav/safety/state" in rates
    services = {service["name"]: service for service in ask(shared_lab, "service", "list")}
    assert services["calibrate_pressure"] == {
        "vehicle": "uav",
        "name": "calibrate_pressure",
        "key": "uav/@srv/calibrate_pressure",
        "type": "Calibrate",
        "node": "pressure",
    }
    assert {"goto", "hold", "reset", "toggle_cage", "safety/set_params"} <= set(services)


def test_topic_echo_prints_one_json_message_per_line(shared_lab: Lab):
    done = shared_lab.quadctl("topic", "echo", "/pose", "-n", 2, "--json")
    assert done.code == 0
    assert [set(row) for row in done.rows] == 2 * [
        {"boot", "seq", "stamp", "position", "velocity", "orientation", "body_rates"}
    ]
    height = shared_lab.quadctl("topic", "echo", "pose", "-n", 1, "--field", "position.z")
    assert float(height.out) > -1


def test_topic_echo_shows_untyped_keys(shared_lab: Lab, bare: Bare):
    listening = shared_lab.spawn(*shared_lab.command("topic", "echo", "my/own", "-n", 1))

    def published_until_end() -> bool:
        bare.session.put("my/own", "plain text")
        return listening.ended

    eventually(published_until_end)
    assert listening.wait() == 0
    assert listening.log == "plain text\n---\n"


def test_state_cage_and_parameters_are_printed_as_json(shared_lab: Lab, hover: Bare):
    state = ask(shared_lab, "state")
    assert set(state) >= STATE_FIELDS
    assert (state["state"], state["pose"]["boot"]) == ("HOVERING", state["boot"])
    assert ask(shared_lab, "cage", "show") == {
        "on": True, "x": [-5.0, 5.0], "y": [-5.0, 5.0], "z": [0.0, 5.0], "zones": [],
    }  # fmt: skip
    assert ask(shared_lab, "param", "get", "/safety/virtual_cage/x") == {
        "safety.virtual_cage.x": 5.0
    }


def test_goto_calibrate_and_service_call_print_their_replies(shared_lab: Lab, hover: Bare):
    flown = ask(shared_lab, "goto", 1, "-0.5", 1)
    assert set(flown) >= {"accepted", "reason", "arrived", "distance", "seconds"}
    assert (flown["accepted"], flown["arrived"], flown["reason"]) == (True, True, "")
    assert 0 < flown["distance"] < 0.5
    assert 0 < flown["seconds"] < 5
    assert hover.state()["goal"]["y"] == -0.5
    calibrated = ask(shared_lab, "calibrate")
    assert set(calibrated) >= {"baseline", "samples", "spread"}
    assert 0 <= calibrated["spread"] < 0.1
    assert 1 <= calibrated["samples"] <= 11
    assert ask(shared_lab, "service", "call", "toggle_cage", "cage_on=true") == {"success": True}
    verdict = ask(shared_lab, "service", "call", "goto", "x=1", "y=-2", "z=1", "replace=true")
    assert verdict == {"accepted": True, "reason": ""}


def test_a_refused_goto_still_prints_its_document(shared_lab: Lab, hover: Bare):
    done = shared_lab.quadctl("goto", 9, 0, 1, "--json")
    assert done.code == 5
    assert (done.json["accepted"], done.json["arrived"]) == (False, False)
    assert done.json["reason"] == done.error["message"]
    assert done.error["code"] == "refused"
