"""Commands without a running system, each in its own folder."""

from pathlib import Path

import pytest

from tests.support.command_line import Quadctl, runner


@pytest.fixture(autouse=True)
def without_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide the runs of this machine's user from the test."""
    for name in ("QUADCTL_REALM", "QUADCTL_VEHICLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    # --identity sets it for the rest of the process: outside tests a process runs one command.
    monkeypatch.setenv("QUADCTL_IDENTITY", "")
    monkeypatch.setattr("quadctl.services.runtime.realm._LONGEST_SOCKET_PATH", 1000)


@pytest.fixture
def quadctl(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Quadctl:
    """Return a function that runs a command without a running system."""
    monkeypatch.chdir(tmp_path)
    return runner(monkeypatch, capsys)
