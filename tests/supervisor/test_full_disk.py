"""A full disk, or a run folder removed by hand, is reported and ends no run."""

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


class PipedRun(NamedTuple):
    """Foreground run with its complete output in a pipe."""

    lab: Lab
    run: Foreground

    def lines_with(self, text: str) -> list[str]:
        """Return the output lines that contain `text`."""
        return [line for line in self.run.log.splitlines() if text in line]


@pytest.fixture
def piped_run() -> Iterator[PipedRun]:
    with private_lab() as lab:
        command = " ".join(map(str, lab.command("up")))
        run = lab.spawn("sh", "-c", f"{command} | cat")
        eventually(lab.is_ready)
        yield PipedRun(lab, run)


def limit_file_size(pid: int, size: int) -> None:
    """Limit the size of a process's files, which acts as a full disk on every machine."""
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


@pytest.mark.thorough
def test_a_run_goes_on_with_a_full_disk_and_reports_it_once(piped_run: PipedRun):
    lab = piped_run.lab
    supervisor = lab.status()["pid"]
    written = (lab.home / "run.json").read_bytes()
    limit_file_size(supervisor, 0)
    try:
        # run.json cannot show the new process now: wait for its first log lines instead.
        lab.signal("pressure", signal.SIGKILL)
        eventually(lambda: len(piped_run.lines_with("pressure | Param: noise")) == 2)
        assert (lab.home / "run.json").read_bytes() == written
        assert len(piped_run.lines_with("cannot be written: ")) == 1
        with lab.bare() as bare:
            eventually(lambda: "pressure" in bare.nodes())
    finally:
        limit_file_size(supervisor, resource.RLIM_INFINITY)
    eventually(lambda: piped_run.lines_with("can be written again; "))
    eventually(lambda: lab.nodes()["pressure"]["restarts"] == 1 and lab.is_ready())
    assert len(piped_run.lines_with("can be written again; ")) == 1
    assert "Traceback" not in piped_run.run.log


@pytest.mark.thorough
def test_a_deleted_run_folder_is_created_again_and_no_node_is_lost(piped_run: PipedRun):
    lab = piped_run.lab
    before, earlier_warnings = lab.nodes(), piped_run.lines_with("cannot be written")
    shutil.rmtree(lab.home)
    eventually(lambda: "hub" in lab.nodes())
    lab.revived("hub", before["hub"]["pid"])
    lab.revived("pressure", lab.signal("pressure", signal.SIGKILL))
    eventually(lab.is_ready)
    assert len(piped_run.lines_with("was removed under the run")) == 1
    assert len(piped_run.lines_with("was created again")) == 1
    assert piped_run.lines_with("cannot be written") == earlier_warnings
    assert lab.quadctl("calibrate").code == 0
    assert lab.quadctl("param", "get", "safety.takeoff").code == 0
    assert lab.quadctl("down").code == 0
    assert piped_run.run.wait() == 0
    assert "Traceback" not in piped_run.run.log


@pytest.mark.thorough
def test_a_run_that_lost_its_realm_ends_and_spares_the_new_holder(lab: Lab):
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
def test_nothing_starts_on_a_full_disk(lab: Lab, words: str):
    command = " ".join(lab.command(*words.split(), "--json"))
    # The test's own log is a file as well, so the command's output goes through a pipe.
    script = f"(ulimit -f 0; {command}; echo exit $?) 2>&1 | cat"
    run = lab.spawn("sh", "-c", script)
    assert run.wait() == 0
    said, code = run.log.splitlines()
    assert code == "exit 1"
    error = json.loads(said)["error"]
    assert str(lab.home) in error["message"]
    assert "room" in error["hint"]
    assert lab.is_gone()


@pytest.mark.thorough
def test_a_run_goes_on_when_its_recording_has_no_space(lab: Lab):
    limit = "ulimit -f 200; exec " + " ".join(lab.command("up", "-d", "--record", "r.mcap"))
    done = subprocess.run(
        ["sh", "-c", limit], env=lab.environment, cwd=lab.folder, check=False, capture_output=True
    )
    assert done.returncode == 0, done
    eventually(lambda: "the recording has stopped: " in lab.log("recorder"))
    assert {n["restarts"] for name, n in lab.nodes().items() if name != "recorder"} == {0}
    assert lab.quadctl("goto", 1, 0, 1).code == 0
