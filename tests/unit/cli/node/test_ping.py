"""Ping of nodes: the errors about a silent node, and the time limit."""

import os
from typing import Any, Self

import pytest

from quadctl.cli import context
from quadctl.cli.context import Options
from quadctl.cli.node import lookup, ping
from quadctl.cli.node.lookup import NodesSeen
from quadctl.services.runtime.bus.calls import gone
from quadctl.services.runtime.errors import NotAllowed, QuadctlError, TimedOut, Unreachable
from quadctl.services.runtime.run_files import ProcessRecord

KEY = "uav/@srv/pressure/get_params"
ENDED = 2**22 + 1
"""Process id above the highest that Linux assigns."""


class SilentClient:
    """Client without any answer; `timeouts` has the timeout (s) of each call."""

    vehicle, timeout = "uav", 1.0

    def __init__(self, problem: QuadctlError) -> None:
        self.problem = problem
        self.timeouts: list[float] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def call(self, _service: Any, _request: Any, timeout: float) -> Any:
        self.timeouts.append(timeout)
        raise self.problem


def asking(problem: QuadctlError, pid: int, state: Any = "ready") -> QuadctlError:
    with pytest.raises(QuadctlError) as caught:
        lookup.params_of(SilentClient(problem), ProcessRecord("pressure", pid, state, 0), [], 0.7)  # type: ignore[arg-type]
    return caught.value


@pytest.mark.parametrize(
    ("pid", "state", "expected"),
    [
        (ENDED, "ready", f"pressure did not answer: its process {ENDED} has ended"),
        (0, "restarting", "pressure did not answer: it is restarting"),
        (0, "ready", "pressure did not answer: it has left the bus"),
    ],
)
def test_a_dead_node_is_reported_by_its_name(pid: int, state: str, expected: str):
    problem = asking(gone(KEY), pid, state)
    assert (type(problem), problem.message) == (Unreachable, expected)
    assert "`quadctl status`" in problem.hint


def test_a_silent_node_with_a_live_process_times_out():
    problem = asking(gone(KEY), os.getpid())
    assert isinstance(problem, TimedOut)
    assert "although its process" in problem.message
    late = asking(TimedOut(f"{KEY} did not answer within 0.7 s", "it is frozen"), os.getpid())
    assert (late.message, late.hint) == ("pressure did not answer within 1 s", "it is frozen")


@pytest.mark.parametrize(
    "problem",
    [
        TimedOut("the hub, process 3, no longer answers"),
        Unreachable("the connection to the hub is lost"),
        NotAllowed("this identity may not"),
    ],
)
def test_errors_not_about_the_node_are_passed_on(problem: QuadctlError):
    assert asking(problem, 0) is problem


class Clock:
    """Stand-in for `time` that advances when set and when slept."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_the_first_pings_get_the_time_left_after_connecting(monkeypatch: pytest.MonkeyPatch):
    clock, silent = Clock(), SilentClient(gone(KEY))

    def connect(_options: Options) -> SilentClient:
        clock.now += 0.6
        return silent

    monkeypatch.setattr(ping, "time", clock)
    monkeypatch.setattr(context, "connect", connect)
    monkeypatch.setattr(ping, "run_of", lambda _options: None)
    processes = [ProcessRecord(name, 0, "ready", 0) for name in ("pressure", "safety")]
    monkeypatch.setattr(ping, "answering", lambda _seen: processes)
    monkeypatch.setattr(ping, "see", lambda *_: NodesSeen(None, [], []))
    with pytest.raises(Unreachable):
        ping.ping(Options("r", "", "uav", json=True, timeout=1.0), every=True)
    assert silent.timeouts == pytest.approx([0.4, 0.4])
