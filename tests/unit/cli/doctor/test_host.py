"""Facts that doctor reads: versions, folders, processes; and the command without a run."""

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


def test_missing_live_and_dead_realms_are_told_apart(
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


def test_process_states_are_read_from_start_to_end():
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


def test_the_disk_check_writes_and_leaves_no_file(tmp_path: Path):
    found = look_at_disk(tmp_path, writing=True)
    assert found.free > 0
    assert (found.refused, list(tmp_path.iterdir())) == ("", [])


@pytest.mark.thorough
def test_without_a_run_the_installation_passes_and_the_run_warns(quadctl: Quadctl):
    result = quadctl("doctor", "--json")
    assert (result.code, result.err) == (0, "")
    checks = {check["name"]: check for check in result.json["checks"]}
    assert result.json["ok"]
    passes = {"Python", "packages", "imports", "clock", "parameter file", "leftovers"}
    assert {checks[name]["verdict"] for name in passes} == {"PASS"}
    assert checks["realm"]["verdict"] == "WARN"
    assert checks["realm"]["fix"] == "`quadctl up -d`"
    assert "hub answers" not in checks


@pytest.mark.thorough
def test_the_text_has_a_line_per_check_with_its_fix_below(quadctl: Quadctl, tmp_path: Path):
    (tmp_path / "quad.toml").write_text("[safety]\ntakeof = 1\n", encoding="utf-8")
    result = quadctl("doctor", "--realm", "mine")
    assert result.code == 8
    assert (
        "FAIL  parameter file: quad.toml: unknown parameter safety.takeof\n"
        "      try: did you mean safety.takeoff?\n"
        "WARN  realm: nothing is running in mine\n"
        "      try: `quadctl up -d --realm mine`\n"
    ) in result.out


@pytest.mark.thorough
def test_a_local_folder_that_shadows_the_package_is_found(quadctl: Quadctl, tmp_path: Path):
    (tmp_path / "quadctl").mkdir()
    assert "PASS  imports" in quadctl("doctor").out
    (tmp_path / "quadctl" / "__init__.py").touch()
    result = quadctl("doctor")
    assert result.code == 0
    assert f"in this folder import quadctl from {tmp_path}" in result.out


@pytest.mark.thorough
def test_a_missing_remote_hub_fails(quadctl: Quadctl):
    result = quadctl("doctor", "--connect", "tcp/127.0.0.1:1", "--timeout", "0.5", "--json")
    checks = {check["name"]: check["verdict"] for check in result.json["checks"]}
    assert (result.code, checks["hub answers"]) == (8, "FAIL")
    assert "realm" not in checks
