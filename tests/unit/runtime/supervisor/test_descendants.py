"""All that carries a command's mark is found, whatever session it has gone to."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from quadctl.services.runtime.supervisor import descendants


@pytest.fixture
def leash() -> str:
    return descendants.new_mark()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as made:
        yield made


def marked(stack: ExitStack, mark: str) -> "subprocess.Popen[bytes]":
    """A process in a session of its own that carries the mark."""
    process = subprocess.Popen(
        ["sleep", "99"], env=os.environ | {descendants.MARK: mark}, start_new_session=True
    )
    stack.callback(process.wait)
    stack.callback(process.kill)
    return process


def test_command_is_found_by_its_own_mark_and_the_runs_mark(leash: str, stack: ExitStack):
    one, other = marked(stack, f"{leash}one/"), marked(stack, f"{leash}one-more/")
    stranger = marked(stack, "4711.1/one/")
    assert descendants.signal_all(f"{leash}one/", signal.SIGTERM) == 1
    assert one.wait() == -signal.SIGTERM
    assert other.poll() is None
    descendants.kill_all(leash)
    assert other.wait() == -signal.SIGKILL
    assert descendants.signal_all(leash, signal.SIGKILL) == 0
    assert stranger.poll() is None


def test_two_runs_of_one_supervisor_have_different_marks(leash: str):
    assert descendants.new_mark() != leash
