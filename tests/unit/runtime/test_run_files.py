"""Files of a run: its current parameters and the record of its processes."""

import os
import resource
import signal
import subprocess
from pathlib import Path

import msgspec
import pytest

from quadctl.schemas.barometer import PressureParams
from quadctl.schemas.params import CageParams, Params, SafetyParams
from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import Invalid, QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.params import live
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import ProcessRecord, RunState
from quadctl.services.runtime.supervisor.control import stop_run

PID = 1 << 22
"""Above all that Linux gives to processes."""
RUN = RunState("lab", PID, ["uav"], [ProcessRecord("hub", PID + 1, "ready", 0, 1.5, 0.5)])


@pytest.fixture
def realm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Realm:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("quadctl.services.runtime.realm._LONGEST_SOCKET_PATH", 1000)
    made = Realm("lab")
    made.create()
    return made


def test_without_a_run_there_is_no_snapshot(realm: Realm):
    assert live.read_values(realm, "uav") is None


def test_saved_parameters_are_read_back(realm: Realm):
    params = Params(
        safety=SafetyParams(virtual_cage=CageParams(1.0, 2.0, 3.0)),
        pressure=PressureParams(noise=1e-300),
        processes={"mine": ["sleep", "9"]},
    )
    live.save_all_values(realm, {"uav": params})
    assert live.read_values(realm, "uav") == params
    live.save_all_values(realm, {"uav": Params()})
    assert live.read_values(realm, "uav") == Params()


def test_a_change_of_one_node_keeps_the_others(realm: Realm):
    live.save_all_values(realm, {"uav": Params()})
    live.save_values(realm, "uav", "pressure", msgspec.to_builtins(PressureParams(rate=20.0)))
    assert live.read_values(realm, "uav") == Params(pressure=PressureParams(rate=20.0))


def test_a_run_that_writes_its_parameters_again_has_those_of_the_launch(realm: Realm):
    live.save_all_values(realm, {"uav": Params()})
    live.save_values(realm, "uav", "pressure", msgspec.to_builtins(PressureParams(rate=20.0)))
    live.save_all_values(realm, {"uav": Params()})
    assert live.read_values(realm, "uav") == Params()


def test_a_partly_written_file_is_not_read(realm: Realm):
    live.save_all_values(realm, {"uav": Params()})
    run_files.changed(realm, "uav").mkdir()
    (realm.params / "uav" / ".safety.json.4711").write_text('{"takeo')
    (realm.params / "uav" / ".safety.json").write_text('{"takeo')
    assert live.read_values(realm, "uav") == Params()


def test_a_change_that_cannot_be_written_is_an_error(realm: Realm):
    live.save_all_values(realm, {"uav": Params()})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
    try:
        with pytest.raises(QuadctlError, match="of pressure cannot be kept in "):
            live.save_values(
                realm, "uav", "pressure", msgspec.to_builtins(PressureParams(rate=20.0))
            )
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert live.read_values(realm, "uav") == Params()


def test_a_snapshot_is_checked_like_a_file(realm: Realm):
    live.save_all_values(realm, {"uav": Params()})
    live.save_values(realm, "uav", "safety", {"takeoff": -1})
    with pytest.raises(Invalid, match=r"safety\.takeoff") as caught:
        live.read_values(realm, "uav")
    assert str(realm.params) in caught.value.message


def test_parameters_of_a_newer_run_that_are_unknown_here_are_left_out(realm: Realm):
    live.save_all_values(realm, {"uav": Params(processes={"mine": ["sleep", "9"]})})
    live.save_values(realm, "uav", "safety", {"takeoff": 2.0, "novelty": 1.0})
    expected = Params(safety=SafetyParams(takeoff=2.0), processes={"mine": ["sleep", "9"]})
    assert live.read_values(realm, "uav") == expected


def test_a_record_is_read_while_its_run_is_live(realm: Realm):
    with FileLock(realm.lock, "the realm"):
        assert run_files.is_live(realm)
        with pytest.raises(Unreachable):
            run_files.read(realm)
        run_files.write(realm, RUN)
        assert run_files.read(realm) == RUN
    assert not run_files.is_live(realm)
    with pytest.raises(Unreachable, match="nothing is running in the realm lab") as caught:
        run_files.read(realm)
    assert caught.value.hint == "`quadctl up -d --realm lab` starts it"


def test_without_any_run_nothing_is_live_and_nothing_is_created(realm: Realm):
    other = Realm("other")
    assert not run_files.is_live(other)
    with pytest.raises(Unreachable):
        stop_run(other)
    assert not other.folder.exists()


def test_stop_waits_no_longer_than_its_timeout(realm: Realm):
    with subprocess.Popen(["sleep", "99"]) as process, FileLock(realm.lock, "the realm"):
        run_files.write(realm, RunState("lab", process.pid, ["uav"], []))
        with pytest.raises(TimedOut, match=rf"process {process.pid} has not ended within 0.05 s"):
            stop_run(realm, 0.05)
        assert process.wait() == -signal.SIGTERM


def test_a_run_that_has_just_ended_counts_as_stopped(realm: Realm, monkeypatch: pytest.MonkeyPatch):
    with FileLock(realm.lock, "the realm") as lock:
        run_files.write(realm, RUN)

        def kill(_pid: int, _number: int) -> None:
            lock.release()
            raise ProcessLookupError

        monkeypatch.setattr(os, "kill", kill)
        assert stop_run(realm) == RUN


def test_the_record_has_the_format_of_status(realm: Realm):
    run_files.write(realm, RUN)
    assert msgspec.json.decode(realm.record.read_bytes()) == {
        "realm": "lab",
        "pid": PID,
        "vehicles": ["uav"],
        "nodes": [
            {
                "name": "hub",
                "pid": PID + 1,
                "state": "ready",
                "restarts": 0,
                "started": 1.5,
                "began": 0.5,
            }
        ],
        "lockstep": False,
        "folder": "",
    }
