"""Processes with a command's mark are found in any session."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from quadctl.services.runtime.supervisor import descendants


@pytest.fixture
def mark_of_run() -> str:
    return descendants.new_mark()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as made:
        yield made


def marked(stack: ExitStack, mark: str) -> "subprocess.Popen[bytes]":
    """Start a process with the mark in its own session."""
    process = subprocess.Popen(
        ["sleep", "99"], env=os.environ | {descendants.MARK: mark}, start_new_session=True
    )
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


def test_command_is_found_by_its_own_mark_and_the_runs_mark(mark_of_run: str, stack: ExitStack):
    one, other = marked(stack, f"{mark_of_run}one/"), marked(stack, f"{mark_of_run}one-more/")
    stranger = marked(stack, "4711.1/one/")
    assert descendants.signal_all(f"{mark_of_run}one/", signal.SIGTERM) == 1
    assert one.wait() == -signal.SIGTERM
    assert other.poll() is None
    descendants.kill_all(mark_of_run)
    assert other.wait() == -signal.SIGKILL
    assert descendants.signal_all(mark_of_run, signal.SIGKILL) == 0
    assert stranger.poll() is None


def test_a_command_that_is_just_being_loaded_is_killed_too(
    mark_of_run: str, stack: ExitStack, monkeypatch: pytest.MonkeyPatch
):
    """The kernel shows no environment of a process that it loads."""
    loading, read, looks = marked(stack, f"{mark_of_run}one/"), descendants._environment, 0

    def environment(pid: int) -> bytes:
        nonlocal looks
        looks += pid == loading.pid
        return b"" if pid == loading.pid and looks < 3 else read(pid)

    monkeypatch.setattr(descendants, "_environment", environment)
    descendants.kill_all(mark_of_run)
    assert loading.wait() == -signal.SIGKILL


def test_two_runs_of_one_supervisor_have_different_marks(mark_of_run: str):
    assert descendants.new_mark() != mark_of_run
