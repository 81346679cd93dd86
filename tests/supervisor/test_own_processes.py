"""A user's own processes, in place of the lab's nodes or in addition to them."""

import os
import signal
import sys
from pathlib import Path

import pytest

from tests.support.lab import NODES, Lab
from tests.support.running import alive, eventually

# A student's safety node: only Zenoh, without quadctl.
STUDENT = """
import json, os, pathlib, zenoh
home = pathlib.Path(os.environ["XDG_RUNTIME_DIR"]) / "quadctl" / os.environ["QUADCTL_REALM"]
config = {"mode": "client", "connect": {"endpoints": [f"unixsock-stream/{home}/hub.sock"],
          "timeout_ms": 5000, "retry": {"period_init_ms": 20, "period_max_ms": 20}},
          "scouting": {"multicast": {"enabled": False}}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))

def refuse(query):
    with query:
        query.reply(query.key_expr, b"\\x82\\xa8accepted\\xc2\\xa6reason\\xaba student's")

goto = session.declare_queryable("uav/@srv/goto", refuse, complete=True)
ready = session.liveliness().declare_token("uav/@node/safety")
offer = session.liveliness().declare_token("uav/@node/safety/@srv/Goto/00000000/0/goto")
print("a student's node is ready", flush=True)
while os.read(0, 1):
    pass
"""
HELPER = "import os, sys; print('in', os.getcwd()); print('said', file=sys.stderr); os.read(0, 1)"


def cmdline(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


@pytest.mark.thorough
def test_an_own_safety_node_runs_beside_a_helper_that_keeps_dying(
    lab: Lab,
):
    (lab.folder / "student.py").write_text(STUDENT, encoding="utf-8")
    (lab.folder / "helper.py").write_text(HELPER, encoding="utf-8")
    commands = 'safety = "python student.py"\nhelper = ["python", "helper.py"]\n'
    doomed = "doomed = \"python -c 'raise SystemExit(3)'\"\n"
    run = lab.spawn(*lab.command("up", lab.file(f"[processes]\n{commands}{doomed}")))
    states = dict.fromkeys([*NODES, "helper"], "ready") | {"doomed": "down"}
    eventually(lambda: {name: node["state"] for name, node in lab.nodes().items()} == states)
    assert "safety   | a student's node is ready" in run.log
    eventually(lambda: f"helper   | in {lab.folder}" in run.log)
    eventually(lambda: "helper   | said" in run.log)
    refused = lab.quadctl("goto", 1, 2, 1, "--no-wait", "--json")
    assert (refused.code, refused.json["reason"]) == (5, "a student's")
    nodes = {node["name"]: node for node in lab.quadctl("node", "list", "--json").json}
    assert len(nodes["safety"]["services"]) == 1
    assert {name: node["state"] for name, node in nodes.items()} == states
    assert "doomed   | " not in run.log
    assert "doomed ended (exit 3): left down" in run.log
    assert lab.quadctl("calibrate").code == 0
    assert lab.quadctl("down").code == 0


@pytest.mark.thorough
def test_up_names_the_processes_that_the_file_gives(lab: Lab):
    file = lab.file("[processes]\nidle = \"sleep 9\"\nmore = ['sh', '-c', 'exec sleep 9']\n")
    started = lab.start(file, "--without", "pressure")
    notes = [line for line in started.err.splitlines() if not line.startswith("starting: ")]
    assert notes == ["idle: sleep 9", "more: sh -c 'exec sleep 9'"]
    assert lab.quadctl("down").code == 0
    run = lab.foreground(file)
    assert run.log.startswith("idle: sleep 9\nmore: sh -c 'exec sleep 9'\n")


@pytest.mark.thorough
def test_an_import_of_an_older_release_fails_with_the_new_name(lab: Lab):
    (lab.folder / "old.py").write_text("from schemas.messages import Pose\n", encoding="utf-8")
    toml = lab.file(f'[processes]\nold = "{sys.executable} -P old.py"\n')
    # On a busy machine Python takes longer to fail than a command needs to count as ready.
    lab.quadctl("up", "-d", toml)
    new = "write `from quadctl.schemas` for `from schemas`"
    eventually(lambda: new in lab.log("old") + lab.taken_logs().get("old.log", ""))


@pytest.mark.thorough
def test_a_command_that_ends_at_once_fails_the_launch(lab: Lab):
    failed = lab.quadctl("up", "-d", lab.file('[processes]\nx = "true"\n'), "--json")
    assert (failed.code, failed.out) == (1, "")
    assert "x does not stay up" in failed.error["message"]
    assert lab.taken_logs()["up.log"].count("x ended (exit 0)") > 1
    assert lab.is_gone()


@pytest.mark.thorough
def test_endless_output_takes_no_memory_and_delays_no_other_node(lab: Lab):
    lab.start(lab.file('[processes]\nyes = "yes"\nblob = "cat /dev/zero"\n'))
    supervisor = lab.status()["pid"]
    logs = lab.home / "logs"

    def memory() -> int:
        """Return the resident memory of the supervisor, kB."""
        status = Path(f"/proc/{supervisor}/status").read_text(encoding="utf-8")
        return int(status.partition("VmRSS:")[2].split()[0])

    def dropped() -> int:
        text = (logs / "yes.log").read_text(encoding="utf-8")
        return sum(int(line.split()[1]) for line in text.splitlines() if "dropped" in line)

    eventually(lambda: dropped() > 100_000)
    before = memory()
    eventually(lambda: dropped() > 2_000_000)
    for node in ("pressure", "safety"):
        lab.revived(node, lab.signal(node, signal.SIGKILL), 3.0)
    assert memory() < before + 10_000
    assert (logs / "blob.log").stat().st_size < 10_000
    assert lab.nodes()["yes"]["restarts"] == lab.nodes()["blob"]["restarts"] == 0


@pytest.mark.thorough
def test_the_children_of_a_killed_command_end_with_it(lab: Lab):
    lab.start(
        lab.file("""[processes]
family = ["sh", "-c", "sleep 98 & setsid sleep 97 & echo started; exec sleep 99"]
""")
    )
    leader = lab.nodes()["family"]["pid"]

    def sleep_pids() -> list[int]:
        """Return the pids of the command's `sleep` processes."""
        return [pid for pid in lab.processes() if b"sleep" in cmdline(pid)]

    eventually(lambda: len(sleep_pids()) == 3)
    old = sleep_pids()
    assert leader in old
    os.kill(leader, signal.SIGKILL)
    lab.revived("family", leader)
    assert not any(map(alive, old))
    eventually(lambda: len(sleep_pids()) == 3)
    assert lab.quadctl("down").code == 0
    assert not sleep_pids()


BATTERY = """
from msgspec import Struct
from quadctl import start
from quadctl.schemas.topics import Topic

class Battery(Struct):
    volts: float

def run(node, params):
    volts = node.publisher(Topic("NAME", Battery, node=node.name, hz=20, doc="Voltage."))
    for _ in node.ticks(20):
        volts.put(Battery(11.1))

start("another_name", run)
"""


def test_the_name_in_processes_is_the_nodes_name_everywhere(lab: Lab):
    for file, topic in (("battery", "own/battery"), ("meter", "power/volts")):
        text = BATTERY.replace("NAME", topic)
        (lab.folder / f"{file}.py").write_text(text, encoding="utf-8")
    lab.start(lab.file('[processes]\nbattery = "python battery.py"\nmeter = "python meter.py"\n'))
    # A command is ready once it has run for a while: its node may follow.
    eventually(lambda: "uav/own/battery" in lab.quadctl("topic", "list").out)
    done = lab.each(["status", "node list", "topic list", "topic info own/battery"])
    assert all(
        "battery" in ended.out and "another_name" not in ended.out for ended in done.values()
    ), done
    assert "uav/own/battery" in done["topic info own/battery"].out
    for topic in ("own/battery", "/uav/own/battery", "power/volts", "uav/power/volts"):
        echoed = lab.quadctl("topic", "echo", topic, "-n", 1, "--json")
        assert (echoed.code, echoed.json) == (0, {"volts": 11.1}), topic
        assert lab.quadctl("topic", "hz", topic, "-n", 2, "--json").json["key"].startswith("uav/")
