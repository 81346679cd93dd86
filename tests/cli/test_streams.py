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
            [sys.executable, "-P", "-m", "quadctl.cli.main", *line.split()],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=30,
        )
    assert done.returncode == 1
    assert "the output cannot be written: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


INTERRUPTED = """
import sys
from quadctl.cli.main import main

class Impatient:
    def find_spec(self, name, path=None, target=None):
        if name == "quadctl.cli.fast_imports":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Impatient())
main()
"""


def test_ctrl_c_while_the_command_is_being_imported_is_no_error():
    done = subprocess.run(
        [sys.executable, "-P", "-c", INTERRUPTED],
        capture_output=True, text=True, check=False, timeout=30,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
