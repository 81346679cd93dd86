"""`node info`, `ping`, `logs`, `kill` and `restart` of the lab's, frozen and foreign nodes."""

import os
import signal
from collections.abc import Iterator

import pytest

from tests.support.lab import NODES, Lab, private_lab
from tests.support.running import eventually


@pytest.fixture(scope="module")
def patient() -> Iterator[Lab]:
    """Lab with a supervisor that does not kill frozen processes."""
    with private_lab() as made:
        made.start("--set", "supervise.answer_timeout=60")
        yield made


@pytest.mark.thorough
def test_node_info_shows_process_topics_and_parameters(patient: Lab):
    done = patient.quadctl("node", "info", "/state_safety_node", "--json")
    assert (done.code, done.err) == (0, "")
    said, row = done.json, patient.nodes()["safety"]
    assert {key: said[key] for key in row} == row
    assert said["supervised"]
    assert {"key": "uav/input/position", "type": "Setpoint", "declared_hz": 20} in said["topics"]
    assert "goto" in [service["name"] for service in said["services"]]
    assert "safety.virtual_cage.x" in said["params"]
    assert 1_000_000 < said["pss"] <= said["rss"] < 1_000_000_000
    # The kernel counts in hundredths of a second; a new node may not have used one yet.
    eventually(lambda: patient.quadctl("node", "info", "safety", "--json").json["cpu"] > 0)
    assert said["uptime"] > 0
    assert patient.quadctl("node", "info", "/uav/safety", "--json").json["pid"] == row["pid"]
    text = patient.quadctl("node", "info", "pressure").out
    assert f"Pid:       {patient.nodes()['pressure']['pid']}\n" in text
    assert " * uav/sensors/pressure [Pressure] 10 Hz\n" in text
    unknown = patient.quadctl("node", "info", "presure", "--json")
    assert (unknown.code, unknown.error["hint"]) == (3, "did you mean pressure?")


def test_node_ping_prints_each_pong_and_a_summary(patient: Lab):
    done = patient.quadctl("node", "ping", "safety", "-n", 3, "--interval", 0, "--json")
    *pongs, last = done.rows
    times = [pong["ms"] for pong in pongs]
    assert [pong["node"] for pong in pongs] == ["safety"] * 3
    assert (last["n"], last["min"], last["max"]) == (3, min(times), max(times))
    assert last["min"] <= last["avg"] <= last["max"]
    everyone = patient.quadctl("node", "ping", "-a", "-c", 1).out.splitlines()
    assert [line.partition(":")[0] for line in everyone] == [
        *(f"pong from {name}" for name in NODES), *NODES,
    ]  # fmt: skip


@pytest.mark.thorough
def test_a_frozen_node_is_exit_4_and_the_others_answer(patient: Lab):
    pid = patient.nodes()["pressure"]["pid"]
    done = patient.quadctl("node", "kill", "pressure", "--signal", "sigstop", "--json")
    assert done.json == {"name": "pressure", "pid": pid, "signal": "STOP"}
    try:
        one = patient.quadctl("node", "ping", "pressure", "--timeout", 0.3, "--json")
        assert (one.code, one.out, one.error["code"]) == (4, "", "timeout")
        # The hub drops it when its lease expires.
        with patient.bare() as bare:
            eventually(lambda: "pressure" not in bare.nodes())
        lines = [
            "node ping --all -n 1",
            "node info pressure",
            "param list",
            "param describe pressure",
        ]
        told = patient.each(lines, "--timeout", "0.5", "--json")
        assert {line: done.code for line, done in told.items()} == {
            lines[0]: 4, lines[1]: 4, lines[2]: 4, lines[3]: 0,
        }  # fmt: skip
        assert {row["node"] for row in told[lines[0]].rows} == set(NODES) - {"pressure"}
        assert told[lines[1]].json["pid"] == pid
    finally:
        assert patient.quadctl("node", "kill", "pressure", "--signal", "CONT").code == 0
    eventually(lambda: patient.quadctl("node", "ping", "pressure", "-n", 1).code == 0)


def launches(lab: Lab) -> int:
    """Return the number of launches in the log of pressure."""
    said = lab.quadctl("node", "logs", "pressure").out.splitlines()
    return sum(line.startswith("Launching") for line in said)


def test_a_killed_node_is_restarted_and_keeps_its_log(patient: Lab):
    # Other tests of this system may have restarted it before.
    pid, before = patient.nodes()["pressure"]["pid"], launches(patient)
    done = patient.quadctl("node", "kill", "pressure", "--signal", "KILL")
    assert done == (
        0, f"pressure (process {pid}): killed; the supervisor restarts it\n", "",
    )  # fmt: skip
    patient.revived("pressure", pid)
    assert launches(patient) == before + 1
    assert "pressure ended (SIGKILL)" in patient.quadctl("node", "logs", "up").out
    by_name = patient.quadctl("node", "logs", "-n", 1, "--json").rows
    assert [row["node"] for row in by_name] == ["dynamics", "pressure", "safety", "up"]


def test_several_nodes_are_killed_together_or_none(patient: Lab):
    before = patient.nodes()
    assert patient.quadctl("node", "kill", "pressure", "nobody").code == 3
    assert patient.nodes() == before
    done = patient.quadctl("node", "kill", "pressure", "/uav/dynamics", "pressure", "--json")
    assert done.rows == [
        {"name": name, "pid": before[name]["pid"], "signal": "TERM"}
        for name in ("pressure", "dynamics")
    ]
    for name in ("pressure", "dynamics"):
        patient.revived(name, before[name]["pid"])


@pytest.mark.thorough
def test_a_foreign_node_is_listed_but_never_signalled(patient: Lab):
    with patient.bare() as bare:
        token = bare.session.liveliness().declare_token("uav/@node/camera")
        nodes = {node["name"]: node for node in patient.quadctl("node", "list", "--json").json}
        assert nodes["camera"]["state"] == "ready"
        said = patient.quadctl("node", "info", "camera", "--json").json
        assert (said["pid"], said["supervised"], said["params"]) == (0, False, [])
        told = patient.each(["node ping camera", "node kill camera"], "--json")
        assert {done.code for done in told.values()} == {3}
        assert "started by hand" in told["node kill camera"].error["hint"]
        assert patient.quadctl("node", "ping", "--all", "-n", 1).code == 0
        token.undeclare()


def test_a_pid_reused_by_another_process_is_not_signalled(patient: Lab):
    record = patient.home / "run.json"
    was = record.read_bytes()
    pid = patient.nodes()["pressure"]["pid"]
    record.write_bytes(was.replace(f'"pid":{pid}'.encode(), f'"pid":{os.getpid()}'.encode()))
    try:
        done = patient.quadctl("node", "kill", "pressure", "--json")
        assert (done.code, done.error["code"]) == (3, "unreachable")
    finally:
        record.write_bytes(was)


def test_the_supervisor_has_a_log_before_its_first_line(lab: Lab):
    lab.start()
    assert lab.quadctl("node", "logs", "up") == (0, "", "")


@pytest.mark.thorough
def test_logs_are_followed_until_ctrl_c_or_the_end_of_the_run(lab: Lab):
    lab.start()
    all_ = lab.spawn(*lab.command("node", "logs", "-f"))
    one = lab.spawn(*lab.command("node", "logs", "safety", "-n", 0, "-f"))
    eventually(lambda: "safety   | Launching" in all_.log)
    toggled = iter(range(1_000))

    def seen() -> bool:
        # Toggle until the second command follows the log, too.
        lab.quadctl("cage", "off" if next(toggled) % 2 else "on")
        return "Cage: off" in one.log and "safety   | Cage: off" in all_.log

    eventually(seen)
    assert "Launching" not in one.log
    one.send(signal.SIGINT)
    assert one.wait() == 130
    assert not all_.ended
    assert lab.quadctl("down").code == 0
    assert all_.wait() == 0


def test_node_restart_restarts_a_frozen_node(patient: Lab):
    before = patient.nodes()["pressure"]
    os.kill(before["pid"], signal.SIGSTOP)
    done = patient.quadctl("node", "restart", "pressure", "--json", "--timeout", "10")
    assert (done.code, done.err) == (0, "")
    after = patient.nodes()["pressure"]
    assert done.json == {"name": "pressure", "before": before["pid"], "pid": after["pid"]}
    assert (after["state"], after["restarts"]) == ("ready", before["restarts"] + 1)
    assert patient.quadctl("calibrate", "--timeout", "10").code == 0


@pytest.mark.parametrize(("words", "code"), [("", 2), ("safety --all", 2), ("saftey", 6)])
def test_node_restart_refuses_an_unknown_or_missing_name(patient: Lab, words: str, code: int):
    before = patient.nodes()
    assert patient.quadctl("node", "restart", *words.split()).code == code
    assert patient.nodes() == before


@pytest.mark.thorough
def test_a_frozen_supervisor_is_reported_and_nothing_claimed_done(patient: Lab):
    supervisor, before = patient.status()["pid"], patient.nodes()["pressure"]["pid"]
    os.kill(supervisor, signal.SIGSTOP)
    try:
        late = patient.quadctl("node", "restart", "pressure", "--timeout", 0.5, "--json")
        assert (late.code, patient.nodes()["pressure"]["pid"]) == (4, before)
        assert late.error["message"] == (
            f"pressure was not restarted: the supervisor, process {supervisor}, did not answer"
            " within 0.5 s"
        )
        killed = patient.quadctl("node", "kill", "pressure")
        assert killed.out == (
            f"pressure (process {before}): asked to end; the supervisor, process {supervisor},"
            " is frozen and restarts it once it goes on\n"
        )
    finally:
        os.kill(supervisor, signal.SIGCONT)
    patient.revived("pressure", before)


def test_a_slow_restart_reports_the_given_timeout(patient: Lab):
    # The supervisor polls ten times a second, and Python alone takes longer to start than 0.04 s.
    before = patient.nodes()["pressure"]["pid"]
    done = patient.quadctl("node", "restart", "pressure", "--timeout", 0.04, "--json")
    assert (done.code, "within 0.04 s" in done.error["message"]) == (4, True)
    patient.revived("pressure", before)
