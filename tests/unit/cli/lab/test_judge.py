"""Starts of a hand-in's node that is not ready in time, with a run that is made up."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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
FLOWN = "flown"


def flown(monkeypatch: pytest.MonkeyPatch, late: int, starts: list[str]) -> list[str]:
    """Return the outputs of the rows with a node that is `late` so many times."""

    @contextmanager
    def run(launch: Launch) -> Iterator[None]:
        starts.append(launch.realm)
        if len(starts) <= late:
            raise QuadctlError(LATE)
        yield

    @contextmanager
    def client(*_: Any, **__: Any) -> Iterator[None]:
        yield

    class Node:
        def __init__(self, *_: Any) -> None:
            self.renew: Callable[[], str] = lambda: FLOWN
            self.logged: Callable[[], bytes] = lambda: b""

    monkeypatch.setattr(judge, "temporary_run", run)
    monkeypatch.setattr(judge, "Client", client)
    monkeypatch.setattr(judge, "_StudentNode", Node)
    results = judge.fly(
        Path(), {"safety": ["x"]}, rubric(TWO, "r.toml"), until=float("inf"),
        wrap=lambda _realm, command: command, evidence=None,
    )  # fmt: skip
    return [result.output for result in results]


def test_a_node_that_is_late_once_is_started_once_more(monkeypatch: pytest.MonkeyPatch):
    starts: list[str] = []
    assert flown(monkeypatch, 1, starts) == [FLOWN, FLOWN]
    assert len(starts) == len({*starts}) == 3


def test_one_that_is_late_again_is_started_no_more(monkeypatch: pytest.MonkeyPatch):
    starts: list[str] = []
    assert flown(monkeypatch, 9, starts) == [LATE, f"not flown: {LATE}"]
    assert len(starts) == 2
