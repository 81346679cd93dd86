"""Commands without a running system: a folder of their own, and no realm of the user's."""

from pathlib import Path

import pytest

from tests.support.command_line import Quadctl, runner


@pytest.fixture(autouse=True)
def nothing_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the user of this machine has running is not seen."""
    for name in ("QUADCTL_REALM", "QUADCTL_VEHICLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    # --identity sets it for the rest of the process, which is one command's elsewhere.
    monkeypatch.setenv("QUADCTL_IDENTITY", "")
    monkeypatch.setattr("quadctl.services.runtime.realm._LONGEST_SOCKET_PATH", 1000)


@pytest.fixture
def quadctl(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Quadctl:
    """Runs a command where nothing runs; returns code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    return runner(monkeypatch, capsys)
