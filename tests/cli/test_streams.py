"""Where what is printed cannot be written."""

import subprocess
import sys
from pathlib import Path

import pytest

FULL = Path("/dev/full")


@pytest.mark.parametrize("line", ["type list", "type list --json"])
def test_a_full_disk_under_stdout_is_told_and_no_fault_of_ours(line: str):
    with FULL.open("w") as full:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "cli.main", *line.split()],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=30,
        )
    assert done.returncode == 1
    assert "the output cannot be written: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
