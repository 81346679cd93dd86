"""How doctor looks: versions, folders and processes as they are, and a line where nothing runs."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from quadctl.cli.doctor.host import folder, look_at_disk, neighbours, process
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.realm import Realm
from tests.support.command_line import Quadctl
from tests.support.running import eventually


def test_a_realm_that_is_not_there_that_is_and_that_has_died(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("quadctl.services.runtime.realm._LONGEST_SOCKET_PATH", 1000)
    realm, other = Realm("mine"), Realm("other")
    assert (folder(realm).mode, folder(realm).run) == (None, None)
    assert neighbours(realm).dead == []
    realm.create()
    other.create()
    with FileLock(realm.folder / "uav.pressure.lock", "a node"):
        found = folder(realm)
        assert (found.mode, found.live, found.by_hand) == (0o700, False, True)
        assert neighbours(other).live == ["mine"]
    with FileLock(realm.lock, "the realm"):
        assert folder(realm).live
        assert folder(realm).holder == str(os.getpid())
    realm.record.write_text("{}", encoding="utf-8")
    assert folder(realm).run is None
    assert neighbours(other) == (str(tmp_path / "quadctl"), [], ["mine"])


def test_a_process_that_runs_is_frozen_and_has_ended():
    started = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        assert process(started.pid).state in {"R", "S", "D"}
        assert eventually(lambda: process(started.pid).memory) > 0
        started.send_signal(signal.SIGSTOP)
        eventually(lambda: process(started.pid).state == "T")
    finally:
        started.kill()
    eventually(lambda: process(started.pid).state == "Z")
    started.communicate()
    assert process(started.pid).state == ""


def test_a_disk_is_tried_and_left_as_it_was(tmp_path: Path):
    found = look_at_disk(tmp_path, writing=True)
    assert found.free > 0
    assert (found.refused, list(tmp_path.iterdir())) == ("", [])


def test_without_a_run_the_installation_passes_and_the_run_warns(quadctl: Quadctl):
    said = quadctl("doctor", "--json")
    assert (said.code, said.err) == (0, "")
    checks = {check["name"]: check for check in said.json["checks"]}
    assert said.json["ok"]
    passes = {"Python", "packages", "imports", "clock", "parameter file", "leftovers"}
    assert {checks[name]["verdict"] for name in passes} == {"PASS"}
    assert checks["realm"]["verdict"] == "WARN"
    assert checks["realm"]["fix"] == "`quadctl up -d`"
    assert "hub answers" not in checks


def test_as_text_each_check_is_a_line_with_its_fix_below(quadctl: Quadctl, tmp_path: Path):
    (tmp_path / "quad.toml").write_text("[safety]\ntakeof = 1\n", encoding="utf-8")
    said = quadctl("doctor", "--realm", "mine")
    assert said.code == 8
    assert (
        "FAIL  parameter file: quad.toml: unknown parameter safety.takeof\n"
        "      try: did you mean safety.takeoff?\n"
        "WARN  realm: nothing is running in mine\n"
        "      try: `quadctl up -d --realm mine`\n"
    ) in said.out


def test_a_folder_here_that_hides_ours_is_found_out(quadctl: Quadctl, tmp_path: Path):
    (tmp_path / "quadctl").mkdir()
    assert "PASS  imports" in quadctl("doctor").out
    (tmp_path / "quadctl" / "__init__.py").touch()
    said = quadctl("doctor")
    assert said.code == 0
    assert f"in this folder import quadctl from {tmp_path}, not quadctl's" in said.out


def test_a_hub_elsewhere_that_is_not_there_is_a_fault(quadctl: Quadctl):
    said = quadctl("doctor", "--connect", "tcp/127.0.0.1:1", "--timeout", "0.5", "--json")
    checks = {check["name"]: check["verdict"] for check in said.json["checks"]}
    assert (said.code, checks["hub answers"]) == (8, "FAIL")
    assert "realm" not in checks
