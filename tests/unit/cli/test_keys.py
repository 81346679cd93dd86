"""`quadctl keys` and `--identity`, without a running system."""

from pathlib import Path

import pytest

from quadctl.services.runtime.security.registry import load
from tests.support.command_line import Quadctl


@pytest.fixture
def fleet(quadctl: Quadctl) -> Path:
    assert quadctl("keys", "init").code == 0
    return Path("keys")


def test_certificates_are_issued_listed_and_revoked(quadctl: Quadctl, fleet: Path):
    issued = quadctl("keys", "issue", "student", "anna", "--vehicle", "uav7", "--json")
    assert issued.json["certificate"] == f"student.anna.{issued.json['serial']}"
    assert issued.json["folder"] == "keys/anna"
    assert issued.json["vehicles"] == ["uav7"]
    assert quadctl("keys", "issue", "operator").out.startswith("keys/operator: operator.operator.")
    listed = quadctl("keys", "list", "--json").json
    assert [(name["name"], name["role"]) for name in listed] == [
        ("operator", "operator"),
        ("anna", "student"),
    ]
    assert "all vehicles" in quadctl("keys", "list").out
    assert quadctl("keys", "revoke", "anna", "--json").json["name"] == "anna"
    assert [name["name"] for name in quadctl("keys", "list", "--json").json] == ["operator"]


def test_each_vehicle_gets_its_own_certificate(quadctl: Quadctl, fleet: Path):
    issued = quadctl("keys", "issue", "hub", "--vehicles", 3, "--json").json
    assert [(name["name"], name["vehicles"]) for name in issued] == [
        (name, [name]) for name in ("uav0", "uav1", "uav2")
    ]
    assert len(load(fleet / "uav2")) == 3


def test_the_fleet_folder_can_be_chosen(quadctl: Quadctl):
    assert quadctl("keys", "init", "--fleet", "other", "--json").json == {"fleet": "other"}
    assert quadctl("keys", "issue", "operator", "--fleet", "other").code == 0
    assert Path("other/operator/key.pem").exists()


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        ("issue studnt anna", 2, "did you mean student?"),
        ("issue student anna/x", 2, "is no name for a certificate"),
        ("issue student anna.x", 2, "is no name for a certificate"),
        ("issue student --vehicle a/b", 2, "is not a valid name for a vehicle"),
        ("issue student anna --days 0", 2, "not a time"),
        ("issue student anna --days nan", 2, "not a time"),
        ("issue student anna --host 10.0.0.1", 2, "is the address of a hub"),
        ("issue student anna --vehicles 3", 2, "each has the name of its vehicle"),
        ("issue student --vehicles 0", 2, "not a number of vehicles"),
        ("issue student --fleet nowhere", 2, "has no fleet's keys"),
        ("list --fleet nowhere", 2, "is not there"),
        ("revoke nobody", 6, "there is no certificate nobody"),
        ("init", 2, "has a fleet's keys already"),
    ],
)
def test_invalid_arguments_are_rejected(
    quadctl: Quadctl, fleet: Path, line: str, code: int, message: str
):
    result = quadctl("keys", *line.split(), "--json")
    assert (result.code, result.out) == (code, "")
    assert message in result.error["message"] + result.error["hint"]
    assert load(fleet) == []


HERE = ("down", "status", "node logs", "node restart safety", "node kill safety", "demo", "fuzz")


@pytest.mark.parametrize("line", HERE)
def test_commands_on_processes_reject_a_remote_hub(quadctl: Quadctl, line: str):
    result = quadctl(*line.split(), "--connect", "tls/field:7447", "--json")
    assert (result.code, result.error["code"]) == (2, "usage")
    assert "needs the run's processes" in result.error["message"]
    assert "ssh" in result.error["hint"]


@pytest.mark.parametrize("line", ["state", "goto 0 0 1", "topic echo pose", "up", "hub"])
def test_a_network_connection_requires_an_identity(quadctl: Quadctl, fleet: Path, line: str):
    result = quadctl(*line.split(), "--connect", "tls/127.0.0.1:1", "--json")
    assert (result.code, result.error["code"]) == (2, "usage")
    assert "--identity" in result.error["hint"]


@pytest.mark.parametrize("line", ["up", "hub", "up --set hub.listen=[]"])
def test_an_open_listener_requires_insecure_or_a_hub_identity(
    quadctl: Quadctl, fleet: Path, line: str
):
    result = quadctl(*line.split(), "--listen", "tcp/0.0.0.0:7447", "--json")
    assert (result.code, result.error["code"]) == (2, "usage")
    assert "--insecure" in result.error["hint"]
    quadctl("keys", "issue", "operator")
    wrong = quadctl(*line.split(), "--listen", "tls/0.0.0.0:1", "--identity", "keys/operator")
    assert wrong.code == 2
    assert "needs the identity of a hub" in wrong.err
