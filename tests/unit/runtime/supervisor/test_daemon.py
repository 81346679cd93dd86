"""The supervisor's process, when its starter is killed during the launch."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("launch", [b"", b'{"realm": "lab", "vehi'])
def test_an_incomplete_launch_starts_nothing(launch: bytes):
    command = (sys.executable, "-P", "-m", "quadctl.services.runtime.supervisor.daemon")
    done = subprocess.run(command, input=launch, capture_output=True, timeout=20, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
