"""The fixtures as another project's tests use them."""

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = """
import pytest
import quadctl

@pytest.mark.quad(params={"dynamics.speed": 0})
def test_flies(quad):
    assert quad.goto(1, 0, 1).distance < 0.5

@pytest.mark.quad(vehicles=2)
def test_has_two(quad_run):
    assert list(quad_run.vehicles) == ["uav0", "uav1"]

def test_fails(quad):
    assert quad.state().cage_on is None

@pytest.mark.quad(params={"safety.nosuch": 1})
def test_cannot_start(quad):
    pass
"""


@pytest.mark.thorough
def test_fixtures_start_a_system_for_each_test_and_show_its_logs_on_failure(tmp_path: Path):
    (tmp_path / "test_mine.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--strict-markers", "-q"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False
    )
    assert "1 failed, 2 passed, 1 error" in done.stdout
    assert "log of safety" in done.stdout
    assert "Requested position: (0, 0, 1)" in done.stdout
    assert "unknown parameter safety.nosuch" in done.stdout
    assert "ResourceWarning" not in done.stdout + done.stderr
