"""Whatever moment it happens at: Ctrl-C in the middle of a launch, many starts at the same time."""

import random
import signal
import sys
import time
from collections.abc import Iterator

import pytest

from tests.support.bare import speed
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import eventually

LAST = 1.35
"""The last moment, s after the start: by then all is ready, where the machine has nothing else to do."""
ENDS = 5.0
"""Seconds in which `up` ends after Ctrl-C."""


@pytest.fixture(scope="module")
def room() -> Iterator[Lab]:
    """A realm for many runs, one after the other."""
    with private_lab() as made:
        yield made


def interrupted(lab: Lab, count: int, seed: int) -> float:
    """So many launches, each ended by Ctrl-C at a random moment; returns how long (s) the slowest took.

    Holds that each ends by its code, and leaves neither process nor folder.
    """
    rng, slowest = random.Random(seed), 0.0
    for number in range(count):
        run = lab.spawn(*lab.command("up"))
        moment = rng.uniform(0, LAST)
        time.sleep(moment)
        sent, begun = time.monotonic(), lab.home.exists()
        run.send(signal.SIGINT)
        code = run.wait(ENDS)
        slowest = max(slowest, time.monotonic() - sent)
        # Before the first line of ours Python ends as it will.
        assert code == 130 if begun else code != 0, (number, moment, code, run.log)
        assert "Traceback" not in run.log or not begun, (number, moment, run.log)
        eventually(lambda: not lab.processes(), 2.0)
        assert not lab.home.exists(), (number, moment, run.log)
    return slowest


def test_ctrl_c_at_any_moment_of_a_launch(room: Lab):
    interrupted(room, 6, seed=1)


@pytest.mark.prove
@pytest.mark.timeout(1200)
def test_ctrl_c_at_two_hundred_moments(room: Lab, proofs: Proofs):
    slowest = interrupted(room, 200, seed=2)
    proofs.add(
        "Ctrl-C at 200 random moments of a launch: processes left behind",
        f"none; ended within {1000 * slowest:.0f} ms",
        f"none, within {ENDS:g} s",
    )


def test_goto_stops_waiting_and_the_flight_goes_on(lab: Lab):
    # Slow, so that the command is still waiting.
    lab.start(*("--set", "dynamics.start.z=1", "--set", "dynamics.control.max_speed=1.0"), *PATIENT)
    with lab.bare() as bare:
        poses = bare.watch("uav/pose")
        waiting = lab.spawn(*lab.command("goto", 4.5, 0, 1))
        eventually(lambda: "accepted" in waiting.log)
        poses.until(lambda pose: speed(pose) > 0.5)
        waiting.send(signal.SIGINT)
        assert waiting.wait() == 130
        assert "stopped waiting: the flight goes on; `quadctl hold` stops it" in waiting.log
        left_at = poses.next()[0]["position"]["x"]
        poses.until(lambda pose: pose["position"]["x"] > min(left_at + 0.5, 4.4))


def many(lab: Lab, count: int) -> None:
    """So many safeties start together: one stays and flies, until it is ended; all others end with 7."""
    command = (sys.executable, "-P", "-m", "quadctl.services.safety")
    started = [lab.spawn(*command) for _ in range(count)]
    eventually(lambda: sum(not each.ended for each in started) <= 1, 60.0)
    (stays,) = [each for each in started if not each.ended]
    others = [each for each in started if each is not stays]
    assert [each.wait() for each in others] == [7] * (count - 1)
    assert all("safety" in each.log for each in others)
    with lab.bare() as bare:
        eventually(lambda: "safety" in bare.nodes())
    assert lab.quadctl("goto", 0, 0, 1.2, "--replace").code == 0
    stays.send(signal.SIGTERM)
    assert stays.wait() == 0


@pytest.fixture(scope="module")
def headless() -> Iterator[Lab]:
    """A system without a safety."""
    with private_lab() as made:
        made.start("--without", "safety", "--set", "dynamics.start.z=1", *PATIENT)
        yield made


def test_of_many_safeties_one_stays(headless: Lab):
    many(headless, 5)


@pytest.mark.prove
@pytest.mark.timeout(600)
def test_of_a_hundred_safeties_one_stays(headless: Lab, proofs: Proofs):
    many(headless, 100)
    proofs.add(
        "100 safeties started together beside one run: that stay",
        "1, and flies; 99 ended with exit 7",
        "1",
    )
