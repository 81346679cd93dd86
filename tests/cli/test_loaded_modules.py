"""Everyday commands load no slow module: each one listed here would cost milliseconds."""

import subprocess
import sys

import pytest

from tests.support.lab import Lab
from tests.support.running import DEADLINE

SLOW = {
    "asyncio", "dataclasses", "decimal", "difflib", "inspect", "json", "logging", "numpy",
    "pathlib", "platform", "quadctl.cli.habits", "quadctl.cli.help_pages", "re", "shlex", "subprocess", "tempfile", "textwrap", "tomllib", "typer",
    "urllib", "uuid",
}  # fmt: skip


@pytest.mark.parametrize(
    "line",
    [
        "service call hold", "goto 0 0 1 --no-wait", "cage show", "state", "topic list",
        "service list", "node list", "param get safety.takeoff", "type show calibrate_pressure",
        "topic echo pose -n 1", "topic info pose", "service info goto",
    ],
)  # fmt: skip
def test_an_everyday_command_loads_nothing_slow(shared_lab: Lab, line: str):
    done = subprocess.run(
        [sys.executable, "-P", "-X", "importtime", "-m", "quadctl.cli.main", *line.split()],
        capture_output=True,
        text=True,
        env=shared_lab.environment,
        check=True,
        timeout=DEADLINE,
    )
    told = [said for said in done.stderr.splitlines() if said.startswith("import time:")]
    loaded = {said.rpartition("|")[2].strip() for said in told}
    assert "zenoh" in loaded or line.startswith("type show")
    assert loaded & SLOW == set()
