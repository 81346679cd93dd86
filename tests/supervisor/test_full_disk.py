"""A full disk, or a folder removed by hand, is told and got over; it ends no run."""

import json
import resource
import shutil
import signal
import subprocess
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from tests.support.lab import Lab, private_lab
from tests.support.running import Foreground, eventually


class Shown(NamedTuple):
    """A run in the foreground, all that it shows behind a pipe."""

    lab: Lab
    run: Foreground

    def said(self, text: str) -> list[str]:
        """The lines that hold a text."""
        return [line for line in self.run.log.splitlines() if text in line]


@pytest.fixture(scope="module")
def shown() -> Iterator[Shown]:
    with private_lab() as lab:
        command = " ".join(map(str, lab.command("up")))
        run = lab.spawn("sh", "-c", f"{command} | cat")
        eventually(lab.is_ready)
        yield Shown(lab, run)


def full(pid: int, size: int) -> None:
    """No file of a process may grow beyond a size: on every machine what a full disk does."""
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def test_a_run_goes_on_when_its_disk_is_full_and_says_so_once(shown: Shown):
    lab = shown.lab
    supervisor = lab.status()["pid"]
    written = (lab.home / "run.json").read_bytes()
    full(supervisor, 0)
    try:
        # Nobody records the new process now: it is known by what it says.
        lab.signal("pressure", signal.SIGKILL)
        eventually(lambda: len(shown.said("pressure | Param: noise")) == 2)
        assert (lab.home / "run.json").read_bytes() == written
        assert len(shown.said("cannot be written: ")) == 1
        with lab.bare() as bare:
            eventually(lambda: "pressure" in bare.nodes())
    finally:
        full(supervisor, resource.RLIM_INFINITY)
    eventually(lambda: shown.said("can be written again; "))
    eventually(lambda: lab.nodes()["pressure"]["restarts"] == 1 and lab.is_ready())
    assert len(shown.said("can be written again; ")) == 1
    assert "Traceback" not in shown.run.log


def test_deleted_run_folder_is_created_again_and_no_node_is_lost(shown: Shown):
    lab = shown.lab
    before, of_the_full_disk = lab.nodes(), shown.said("cannot be written")
    shutil.rmtree(lab.home)
    eventually(lambda: "hub" in lab.nodes())
    lab.revived("hub", before["hub"]["pid"])
    lab.revived("pressure", lab.signal("pressure", signal.SIGKILL))
    eventually(lab.is_ready)
    assert len(shown.said("was removed under the run")) == 1
    assert len(shown.said("was made anew")) == 1
    assert shown.said("cannot be written") == of_the_full_disk
    assert lab.quadctl("calibrate").code == 0
    assert lab.quadctl("param", "get", "safety.takeoff").code == 0
    assert lab.quadctl("down").code == 0
    assert shown.run.wait() == 0
    assert "Traceback" not in shown.run.log


def test_run_ends_when_its_realm_is_taken_and_leaves_it_alone(lab: Lab):
    first = lab.foreground()
    first.send(signal.SIGSTOP)
    shutil.rmtree(lab.home)
    lab.start()
    second = lab.status()
    first.send(signal.SIGCONT)
    assert first.wait() == 7
    assert f"is already held by process {second['pid']}" in first.log
    assert "Traceback" not in first.log
    assert lab.status() == second
    assert lab.quadctl("calibrate").code == 0


@pytest.mark.parametrize("words", ["up", "up -d"])
def test_on_a_full_disk_nothing_is_started(lab: Lab, words: str):
    command = " ".join(lab.command(*words.split(), "--json"))
    # The test's own log is a file as well, so the command's words go through a pipe.
    script = f"(ulimit -f 0; {command}; echo exit $?) 2>&1 | cat"
    run = lab.spawn("sh", "-c", script)
    assert run.wait() == 0
    said, code = run.log.splitlines()
    assert code == "exit 1"
    error = json.loads(said)["error"]
    assert str(lab.home) in error["message"]
    assert "room" in error["hint"]
    assert lab.is_gone()


def test_a_run_goes_on_when_its_recording_finds_no_room(lab: Lab):
    limit = "ulimit -f 200; exec " + " ".join(lab.command("up", "-d", "--record", "r.mcap"))
    done = subprocess.run(
        ["sh", "-c", limit], env=lab.environment, cwd=lab.folder, check=False, capture_output=True
    )
    assert done.returncode == 0, done
    eventually(lambda: "the recording has stopped: " in lab.log("recorder"), 30.0)
    assert {n["restarts"] for name, n in lab.nodes().items() if name != "recorder"} == {0}
    assert lab.quadctl("goto", 1, 0, 1).code == 0
