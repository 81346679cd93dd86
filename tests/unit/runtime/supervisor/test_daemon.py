"""The supervisor's own process, where whoever started it is killed over it."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("asked", [b"", b'{"realm": "lab", "vehi'])
def test_of_a_launch_that_did_not_come_whole_nothing_is_made(asked: bytes):
    command = (sys.executable, "-P", "-m", "quadctl.services.runtime.supervisor.daemon")
    done = subprocess.run(command, input=asked, capture_output=True, timeout=20, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
