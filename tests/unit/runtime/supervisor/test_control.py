"""Requests to restart a process, by name, through the realm's folder."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import Invalid, QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.filelock import FileLock
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import ProcessRecord, RunState, State
from quadctl.services.runtime.supervisor import control


@pytest.fixture
def realm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Realm]:
    """Yield a live realm with a hub and a pressure node."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("quadctl.services.runtime.realm._LONGEST_SOCKET_PATH", 1000)
    made = Realm("lab")
    made.create()
    with FileLock(made.lock, "the realm"):
        write(made, 12, "ready", 0)
        yield made


def write(realm: Realm, pid: int, state: State, restarts: int) -> ProcessRecord:
    pressure = ProcessRecord("pressure", pid, state, restarts)
    hub = ProcessRecord("hub", 11, "ready", 0)
    run_files.write(realm, RunState("lab", 10, ["uav"], [hub, pressure]))
    return pressure


def test_a_restart_request_is_taken_once(realm: Realm):
    assert control.pending_restarts(realm) == []
    assert control.request_restart(realm, "pressure") == ProcessRecord("pressure", 12, "ready", 0)
    control.request_restart(realm, "pressure")
    control.request_restart(realm, "hub")
    assert sorted(control.pending_restarts(realm)) == ["hub", "pressure"]
    assert control.pending_restarts(realm) == []


def test_an_unknown_name_is_refused_with_the_nearest(realm: Realm):
    with pytest.raises(Invalid, match="presure: there is no such process") as caught:
        control.request_restart(realm, "presure")
    assert caught.value.hint == "did you mean pressure?"
    with pytest.raises(Invalid) as caught:
        control.request_restart(realm, "../../x")
    assert caught.value.hint == "there are hub, pressure"
    assert control.pending_restarts(realm) == []


def test_a_request_without_a_run_is_an_error(realm: Realm):
    with pytest.raises(Unreachable, match="nothing is running in the realm other"):
        control.request_restart(Realm("other"), "hub")


def test_a_restart_ends_when_the_new_process_is_ready(realm: Realm):
    before = control.request_restart(realm, "pressure")
    with pytest.raises(TimedOut, match=r"pressure is not ready again within 0\.03 s"):
        control.wait_restarted(realm, "pressure", before, 0.03)
    write(realm, 12, "restarting", 1)
    later = threading.Timer(0.05, lambda: write(realm, 13, "ready", 1))
    later.start()
    assert control.wait_restarted(realm, "pressure", before, 5.0).pid == 13
    later.join()


def test_a_node_that_goes_down_again_is_an_error_at_once(realm: Realm):
    before = write(realm, 0, "down", 4)
    with pytest.raises(TimedOut):
        control.wait_restarted(realm, "pressure", before, 0.0)
    write(realm, 0, "down", 8)
    with pytest.raises(QuadctlError, match="does not stay up") as caught:
        control.wait_restarted(realm, "pressure", before, 5.0)
    assert str(realm.logs / "pressure.log") in caught.value.hint
