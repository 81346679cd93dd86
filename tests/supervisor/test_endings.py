"""A run leaves nothing behind however it ends; a realm or node name has one holder at most."""

import contextlib
import os
import shlex
import shutil
import signal
import sys
from pathlib import Path

import pytest

from tests.support.lab import NODES, Lab
from tests.support.proofs import Proofs
from tests.support.running import alive, eventually

# A user's processes that do not use quadctl: one ignores SIGTERM, one reads no pipe, and one has
# children that ignore SIGTERM, have their own session, or are orphans.
HELPERS = """
[processes]
deaf = ["python", "-c", "import signal, time; signal.signal(15, signal.SIG_IGN); time.sleep(99)"]
sleeper = "sleep 99"
family = ["sh", "-c", '''
    (trap : TERM; sleep 98; sleep 98) &
    setsid sh -c "trap : TERM; sleep 97; sleep 97" &
    (sleep 96 &)
    wait
''']
"""


def sleep_durations(lab: Lab) -> set[str]:
    """Return the duration argument of each running `sleep` of the helpers."""
    found = set()
    for pid in lab.processes():
        with contextlib.suppress(OSError):
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            if words[0] == b"sleep":
                found.add(words[1].decode())
    return found


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0), (signal.SIGHUP, 0)]
)
def test_a_signal_ends_a_foreground_run_and_all_its_processes(lab: Lab, number: int, code: int):
    run = lab.foreground(lab.file(HELPERS))
    pids = lab.pids()
    assert len(pids) == 8
    assert all(map(alive, pids))
    eventually(lambda: sleep_durations(lab) == {"96", "97", "98", "99"})
    run.send(number)
    assert run.wait() == code, run.log
    assert not any(map(alive, pids))
    assert lab.is_gone()
    assert "Traceback" not in run.log


@pytest.mark.thorough
@pytest.mark.parametrize("detached", [False, True], ids=["foreground", "detached"])
def test_up_killed_with_sigkill_leaves_no_process_behind(lab: Lab, detached: bool):
    file = lab.file(HELPERS)
    if detached:
        lab.start(file)
    else:
        lab.foreground(file)
    pids = lab.pids()
    eventually(lambda: sleep_durations(lab) == {"96", "97", "98", "99"})
    os.kill(pids[0], signal.SIGKILL)
    eventually(lambda: not any(map(alive, pids)) and not lab.processes())
    if detached:  # the next run clears the leftover folder and is not disturbed by it
        (lab.home / "params" / "safety.json").write_text('{"takeoff": -1}')
        (lab.home / "asked").mkdir()
        (lab.home / "asked" / "hub").touch()
        lab.start()
        assert not (lab.home / "logs" / "sleeper.log").exists()
        assert {node["restarts"] for node in lab.nodes().values()} == {0}
        assert lab.quadctl("param", "get", "safety.takeoff", "--json").json == {"safety.takeoff": 1}
    else:
        assert lab.quadctl("status").code == 3
        shutil.rmtree(lab.home)


def test_two_realms_run_side_by_side_and_do_not_see_each_other(shared_lab: Lab):
    other = ("--realm", "other")
    assert shared_lab.quadctl("up", "-d", *other, "--set", "safety.virtual_cage.x=2").code == 0
    try:
        mine = shared_lab.quadctl("cage", "show", "--json").json
        theirs = shared_lab.quadctl("cage", "show", "--json", *other).json
        assert (mine["x"], theirs["x"]) == ([-5, 5], [-2, 2])
        assert shared_lab.quadctl("goto", 3, 0, 1, *other).code == 5
        with shared_lab.bare() as bare:
            assert bare.nodes() == ["dynamics", "hub", "pressure", "safety"]
    finally:
        down = shared_lab.quadctl("down", *other)
    assert down.code == 0
    assert shared_lab.is_ready()


def test_a_node_started_a_second_time_exits_7(shared_lab: Lab):
    before = shared_lab.status()
    command = (sys.executable, "-P", "-m")
    seconds = {node: shared_lab.spawn(*command, f"quadctl.services.{node}") for node in NODES}
    assert {node: second.wait() for node, second in seconds.items()} == dict.fromkeys(NODES, 7)
    assert all(node in second.log for node, second in seconds.items())
    assert shared_lab.status() == before


@pytest.mark.thorough
def test_a_node_left_out_of_a_run_can_be_started_separately(lab: Lab):
    lab.start("--without", "pressure")
    command = (sys.executable, "-P", "-m", "quadctl.services.pressure", "--realm", lab.realm)
    alone = lab.spawn(*command, "--set", "pressure.rate=20")
    with lab.bare() as bare:
        eventually(lambda: "pressure" in bare.nodes())
        assert bare.watch("uav/sensors/pressure").next()[0]["pressure"] > 1000
        rate = bare.call("pressure/get_params", names=["pressure.rate"])
        assert rate.value == {"values": {"pressure.rate": 20}}
    second = lab.spawn(*command)
    assert second.wait() == 7
    listed = lab.quadctl("node", "list", "--json").json
    assert "pressure" in [node["name"] for node in listed]
    alone.send(signal.SIGTERM)
    assert alone.wait() == 0


def run_and_end(lab: Lab, times: int) -> None:
    """Start and stop a run `times` times, every other time with helpers that ignore SIGTERM."""
    helpers = lab.file(HELPERS)
    for number in range(times):
        lab.start(*[helpers] * (number % 2))
        pids = lab.pids()
        down = lab.quadctl("down", "--json")
        assert (down.code, down.err) == (0, "")
        assert down.json["pid"] == pids[0]
        assert not any(map(alive, pids[1:]))
        assert not lab.home.exists()
        eventually(lambda: not lab.processes())


@pytest.mark.thorough
def test_starts_and_stops_leave_nothing_behind(lab: Lab):
    run_and_end(lab, 10)


@pytest.mark.prove
@pytest.mark.timeout(600)
def test_a_hundred_starts_and_stops_leave_nothing_behind(lab: Lab, proofs: Proofs):
    run_and_end(lab, 100)
    proofs.add(
        "100 starts and stops, half of them with processes that ignore SIGTERM: left behind",
        "no process, no file",
        "nothing",
    )


def test_a_frozen_process_does_not_outlive_a_killed_up(lab: Lab):
    lab.start()
    pids = lab.pids()
    lab.signal("safety", signal.SIGSTOP)
    os.kill(lab.status()["pid"], signal.SIGKILL)
    eventually(lambda: not any(map(alive, pids)))
    shutil.rmtree(lab.home)


@pytest.mark.thorough
def test_nodes_that_wait_for_a_hub_do_not_outlive_a_killed_up(lab: Lab):
    lab.spawn(*lab.command("up", lab.file('[processes]\nhub = "sleep 99"')))
    eventually(lambda: len(lab.pids()) == 5 and all(lab.pids()))
    os.kill(lab.status()["pid"], signal.SIGKILL)
    eventually(lambda: not lab.processes())
    shutil.rmtree(lab.home)


@pytest.mark.thorough
@pytest.mark.parametrize("asked", ["interrupt", "down"])
def test_a_run_whose_output_nobody_reads_is_supervised_and_ends(lab: Lab, asked: str):
    os.mkfifo(lab.folder / "pipe")
    pipe = os.open(lab.folder / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    command = lab.command("up", lab.file('[processes]\nnoisy = "yes"'))
    run = lab.spawn("sh", "-c", f"exec {shlex.join(command)} > pipe")
    eventually(lambda: lab.is_ready() and lab.log("noisy").count("y") > 5000)  # a full pipe
    lab.revived("pressure", lab.signal("pressure", signal.SIGKILL))
    if asked == "down":
        assert lab.quadctl("down").code == 0
    else:
        run.send(signal.SIGINT)
    assert run.wait() == (0 if asked == "down" else 130)
    os.close(pipe)
    assert lab.is_gone()


@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&- 2>&-"])
def test_a_run_starts_with_its_standard_streams_closed(lab: Lab, closed: str):
    launched = lab.spawn("sh", "-c", f"exec {shlex.join(lab.command('up', '-d'))} {closed}")
    assert launched.wait() == 0
    assert launched.log in {"", f"realm {lab.realm} is up\n"}
    assert lab.is_ready()
    eventually(lambda: "Launching with" in lab.log("pressure"))
    assert lab.quadctl("down").code == 0
    assert lab.is_gone()


def test_a_closed_terminal_does_not_end_a_run_under_nohup(lab: Lab):
    run = lab.spawn("sh", "-c", f"trap '' HUP; exec {shlex.join(lab.command('up'))}")
    eventually(lab.is_ready)
    run.send(signal.SIGHUP)
    lab.revived("pressure", lab.signal("pressure", signal.SIGKILL))
    assert not run.ended


def test_a_demo_ended_by_a_signal_leaves_nothing(lab: Lab):
    run = lab.spawn(*lab.command("demo"))
    eventually(lambda: [*lab.home.parent.glob("demo-*/run.json")])
    run.send(signal.SIGTERM)
    assert run.wait() == 128 + signal.SIGTERM, run.log
    eventually(lambda: not lab.processes())
    assert not [*lab.home.parent.glob("demo-*")]
