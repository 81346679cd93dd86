"""Vehicle, router and operator on three machines, over mutual TLS: only permitted actions work."""

import json
import shutil
import signal
from pathlib import Path

import pytest

from tests.support.network_field import PLAIN, QUIC, Field, touched
from tests.support.running import eventually

OURS = (b"position", b"uav/pose", b"quadctl.Pose", b"calibrate_pressure", b"baseline", b"cage_on")
"""Words that would be visible in our packets without encryption."""


@pytest.mark.thorough
def test_checkpoints_pass_across_machines_with_encrypted_traffic(net: Field, tmp_path: Path):
    with net.sniffed(tmp_path / "tls"):
        ranges = net.ask("param get safety.virtual_cage", json=True).json
        assert ranges["safety.virtual_cage.x"] == 5.0
        flown = net.ask("goto 1 2 1", json=True)
        assert (flown.code, flown.json["arrived"]) == (0, True), flown.err
        assert net.ask("goto 9 0 1").code == 5
        calibrated = net.ask("calibrate", json=True).json
        assert 1000 < calibrated["baseline"] < 1030
        assert net.ask("cage off").code == 0
        assert net.ask("goto 6 0 1 --no-wait").code == 0
        assert net.ask("cage on").code == 0
        assert net.ask("goto 0 0 1 --replace --no-wait").code in {0, 5}
        assert net.ask("topic echo pose -n 20").code == 0
    carried = (tmp_path / "tls").read_bytes()
    assert len(carried) > 10_000
    assert [word for word in OURS if word in carried] == []


@pytest.mark.thorough
def test_a_capture_finds_the_words_on_a_plain_link(net: Field, tmp_path: Path):
    plain = ["hub", "-d", "--realm", "plain", "--listen", PLAIN]
    refused = net.router.quadctl(*plain)
    assert refused.code == 2
    assert "--insecure" in refused.err
    opened = net.router.quadctl(
        *plain, "--insecure", "--connect", "tls/10.7.1.1:7447", "--identity", net.keys / "router"
    )
    assert opened.code == 0, opened.err
    with net.sniffed(tmp_path / "plain"):
        eventually(lambda: net.ask("topic echo pose -n 20", at=PLAIN).code == 0)
        assert net.ask("calibrate", at=PLAIN).code == 0
    carried = (tmp_path / "plain").read_bytes()
    assert [word for word in OURS if word not in carried] == [b"cage_on"]
    assert net.router.quadctl("down", "--realm", "plain").code == 0


def test_commands_work_over_quic(net: Field):
    assert net.ask("state", at=QUIC).code == 0
    assert net.ask("hold", at=QUIC).code == 0


@pytest.mark.thorough
def test_only_the_router_has_listening_sockets(net: Field):
    vehicle, router, operator = net.machines
    assert vehicle.sockets() == operator.sockets() == []
    # Behind the door, Zenoh listens on the loopback interface.
    others = [found for found in router.sockets() if not found.startswith("tcp 0100007F:")]
    assert others == ["tcp 00000000:1D17", "udp 00000000:1D17"]


DENIED = (
    ("eve", "goto 0 0 1", "an observer of all vehicles may not call uav/@srv/goto"),
    ("eve", "cage off", "an observer of all vehicles may not call uav/@srv/toggle_cage"),
    ("eve", "topic pub input/position_request x=0 y=0 z=1", "may not publish on"),
    ("una", "cage off", "a student of uav may not call uav/@srv/toggle_cage"),
    ("una", "param set safety.takeoff 2", "a student of uav may not call uav/@srv/safety/set_para"),
    (
        "una",
        "topic pub uav9/own/x text --no-wait",
        "a student of uav may not publish on uav9/own/x",
    ),
    ("una", "topic echo uav9/pose -n 1", "may not listen to uav9/pose"),
    ("bob", "hold --vehicle uav", "a student of uav9 may not call uav/@srv/hold"),
    ("bob", "topic echo uav/pose -n 1", "a student of uav9 may not listen to uav/pose"),
    ("bob", "state --vehicle uav", "a student of uav9 may not"),
)


def test_a_denied_command_fails_at_once_with_the_reason(net: Field):
    before = touched(net.vehicle)
    for who, line, why in DENIED:
        done = net.ask(line, who)
        assert done.code == 3, (line, done)
        assert "not allowed: " in done.err
        assert why in done.err
        assert f".{who}." in done.err, "the error has the certificate's name"
    assert touched(net.vehicle) == before


@pytest.mark.thorough
def test_a_refusal_by_the_hub_is_not_reported_as_a_hub_down(net: Field):
    """Call with a certificate that permits uav, while the router's list does not."""
    listed = net.keys / "router" / "names.json"
    original = listed.read_bytes()
    names = json.loads(original)
    for name in names:
        if name["name"] == "una":
            name["vehicles"] = ["uav9"]
    listed.write_text(json.dumps(names), encoding="utf-8")
    before = touched(net.vehicle)

    def denied() -> bool:
        return "keeps student.una." in net.ask("hold --timeout 0.5", "una").err

    eventually(denied)
    assert touched(net.vehicle) == before
    listed.write_bytes(original)
    eventually(lambda: net.ask("hold", "una").code == 0)


def test_a_default_up_opens_no_listening_socket(net: Field):
    operator = net.machines[2]
    assert net.operator.quadctl("up", "-d").code == 0
    assert operator.sockets() == []
    assert net.operator.quadctl("down").code == 0


@pytest.mark.thorough
def test_permitted_commands_work(net: Field):
    assert net.ask("state", "eve").code == 0
    assert net.ask("topic echo safety/state -n 1", "eve").code == 0
    assert "safety" in net.ask("topic list", "eve").out
    assert net.ask("goto 0 1 1 --replace", "una").code == 0
    assert net.ask("calibrate", "una").code == 0


@pytest.mark.thorough
def test_the_nodes_of_one_vehicle_run_on_two_machines(net: Field):
    net.issue("hub drone --vehicle drone")
    net.issue("safety guard --vehicle drone")
    net.issue("vehicle sensor --vehicle drone")
    up = net.vehicle.quadctl(
        *("up", "-d", "--realm", "drone", "--vehicle", "drone", "--without", "pressure"),
        *(
            "--without",
            "safety",
            "--connect",
            "tls/10.7.1.1:7447",
            "--identity",
            net.keys / "drone",
        ),
    )
    assert up.code == 0, up.err
    # A barometer's certificate may not run safety.
    wrong = net.node("safety", "drone", "sensor")
    assert wrong.wait() == 3
    assert "a vehicle of drone may not announce drone/@node/safety" in wrong.log
    nodes = [net.node("safety", "drone", "guard"), net.node("pressure", "drone", "sensor")]
    # On a busy machine the two nodes, two commands and three gates take long.
    eventually(lambda: net.ask("calibrate --vehicle drone").code == 0, 40.0)
    eventually(lambda: net.ask("goto 1 0 1 --vehicle drone").code == 0, 40.0)
    assert net.ask("topic hz drone/input/position -n 5").code == 0
    for node in nodes:
        node.send(signal.SIGTERM)
        assert node.wait() == 0
    assert net.vehicle.quadctl("down", "--realm", "drone").code == 0
    # A node that was started separately leaves its lock file.
    shutil.rmtree(net.operator.home)


@pytest.mark.thorough
def test_a_vehicle_that_does_not_run_is_not_reported_as_denied(net: Field):
    """Call a vehicle that bob may fly but that does not run."""
    done = net.ask("goto 0 0 1 --timeout 1", "bob")
    assert done.code == 3
    assert "nobody served uav9/@srv/goto" in done.err
    assert "not allowed" not in done.err


@pytest.mark.parametrize(
    ("who", "heard", "replied"),
    [
        ("bob", set(), {"uav/info"}),
        ("eve", {"uav/pose"}, {"uav/info", "uav/safety/state"}),
    ],
)
def test_zenohs_access_control_stops_a_client_without_quadctl(
    net: Field, who: str, heard: set[str], replied: set[str]
):
    with net.vehicle.bare() as bare:
        calls = bare.watch_calls("**")
        setpoints = bare.watch("uav/input/position")
        before = touched(net.vehicle)
        got = net.intrude(who)
        assert touched(net.vehicle) == before
        assert calls.messages == []
        assert all(point["position"]["x"] < 9 for point in setpoints.messages)
    assert got["asked"] == []
    assert heard <= set(got["heard"]) or not heard
    assert {key.partition("/")[0] for key in got["heard"]} <= ({"uav"} if heard else set())
    assert set(got["replied"]) <= replied
    names = {key.split("/")[2] for key in got["seen"]}
    assert names <= ({"hub", "gate"} if who == "bob" else names)
    assert "safety2" not in net.ask("node list").out
