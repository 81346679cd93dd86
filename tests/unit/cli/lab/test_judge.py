"""Start of a hand-in's node that is not ready in time, with a run that is made up."""

from pathlib import Path
from typing import NoReturn

import pytest

from quadctl.cli.lab import judge
from quadctl.cli.lab.rubric import rubric
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.supervisor.launch import Launch

ROW = {
    "expect": "arrives",
    "rows": [{"at": 4.0, "do": "goto", "x": 1.0, "y": 1.0, "z": 1.0}],
}
TWO = {"row": [ROW | {"name": "a"}, ROW | {"name": "b", "set": {"safety": {"margin": 0.2}}}]}
"""Two rows, each with a run of its own."""
LATE = "safety is not ready: 1 of 3 nodes"


def test_a_node_that_is_not_ready_in_time_is_started_no_more(monkeypatch: pytest.MonkeyPatch):
    starts: list[str] = []

    def run(launch: Launch) -> NoReturn:
        starts.append(launch.realm)
        raise QuadctlError(LATE)

    monkeypatch.setattr(judge, "temporary_run", run)
    results = judge.fly(
        Path(), {"safety": ["x"]}, rubric(TWO, "r.toml"), until=float("inf"),
        wrap=lambda _realm, command: command, evidence=None,
    )  # fmt: skip
    assert [result.output for result in results] == [LATE, f"not flown: {LATE}"]
    assert len(starts) == 1
