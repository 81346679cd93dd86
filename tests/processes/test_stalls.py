"""Processes that do not run for a while: a flight pauses, and goes on or gives up by the grace.

What is assumed of the machine, that it keeps nobody from running for longer than the grace, is measured
beside: a thread that only sleeps counts how late it wakes.
"""

import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.processes.bare import Bare, Watch, gap, speed
from tests.processes.lab import NODES, Lab, private_lab
from tests.processes.running import eventually
from tests.processes.sleeper import Sleeper
from tests.proofs import Proofs

MARGIN = 0.01
CAGE = {"x": (-5, 5), "y": (-5, 5), "z": (0, 5)}


@contextmanager
def stalling(lab: Lab, draw: random.Random, seconds: tuple[float, float]) -> Iterator[list[float]]:
    """Stop a process of the system chosen at random, or all at once, every two seconds."""
    done, stalls = threading.Event(), []

    def stall() -> None:
        while not done.wait(draw.uniform(1.5, 2.0)):
            nodes = draw.choice([*([name] for name in NODES), NODES])
            pids = [node["pid"] for name, node in lab.nodes().items() if name in nodes]
            length = draw.uniform(*seconds)
            for pid in pids:
                os.kill(pid, signal.SIGSTOP)
            done.wait(length)
            for pid in pids:
                os.kill(pid, signal.SIGCONT)
            stalls.append(length)

    thread = threading.Thread(target=stall, daemon=True)
    thread.start()
    try:
        yield stalls
    finally:
        done.set()
        thread.join()


@pytest.fixture(scope="module")
def flying() -> Iterator[Lab]:
    with private_lab() as made:
        made.start("--set", "dynamics.start.z=1")
        yield made


def goal_from(draw: random.Random, here: dict[str, float]) -> dict[str, float]:
    """Some way off, as likely as not on a wall."""
    while True:
        goal = {
            axis: draw.choice((low, high)) if draw.random() < 0.3 else draw.uniform(low, high)
            for axis, (low, high) in CAGE.items()
        }
        if 1 < gap(goal, here) < 3:
            return goal


def ask(bare: Bare, goal: dict[str, float]) -> None:
    answer = bare.call("goto", timeout=10.0, **goal, replace=True)
    assert answer.value == {"accepted": True, "reason": ""}


def fly(bare: Bare, states: Watch, goal: dict[str, float]) -> str:
    """One flight; returns why it did not arrive, empty where it did."""
    ask(bare, goal)
    ended: dict[str, Any] = states.until(
        lambda s: (
            s["state"] == "HOVERING"
            and not s["reason"].startswith("paused")
            and (s["goal"] == goal or s["reason"] != "")
        ),
        within=30,
    )
    return "" if ended["goal"] == goal and not ended["reason"] else str(ended["reason"])


def farthest(poses: Watch) -> float:
    """How far out of the cage the vehicle has been, m."""
    return max(
        max(low - pose["position"][axis], pose["position"][axis] - high)
        for pose in poses.messages
        for axis, (low, high) in CAGE.items()
    )


def among_stalls(lab: Lab, count: int, seed: int) -> tuple[list[str], float, str]:
    """So many flights; why some did not arrive, how far out of the cage, and what was assumed."""
    draw, sleeper, problems, out = random.Random(seed), Sleeper(), [], -1.0
    with stalling(lab, random.Random(seed + 1), (0.1, 0.5)) as stalls:
        for _ in range(0, count, 20):
            with lab.bare() as bare:
                poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
                for _ in range(20):
                    here = poses.next()[0]["position"]
                    if why := fly(bare, states, goal_from(draw, here)):
                        problems.append(why)
                out = max(out, farthest(poses))
    assert len(stalls) > count / 5
    return problems, out, f"{len(stalls)} stalls of ours; {sleeper.stop()}"


@pytest.mark.parametrize("seed", range(3))
def test_sixty_flights_among_short_stalls(flying: Lab, seed: int):
    problems, out, assumed = among_stalls(flying, 20, seed=seed)
    assert problems == [], assumed
    assert out <= MARGIN


@pytest.mark.prove
@pytest.mark.timeout(7200)
def test_a_thousand_flights_among_short_stalls(flying: Lab, proofs: Proofs):
    problems, out, assumed = among_stalls(flying, 1000, seed=2)
    proofs.add(
        "1000 flights, a process or all stopped for 0.1 to 0.5 s every 2 s",
        f"{1000 - len(problems)} arrived, at most {1000 * max(out, 0):.1f} mm out of the cage"
        f" ({assumed})",
        "999, 10 mm",
    )
    assert len(problems) <= 1, problems
    assert out <= MARGIN


def outage(lab: Lab, nodes: list[str], draw: random.Random) -> None:
    """Stop some in flight for 2 s: the flight ends with its reason, and does not go on by itself."""
    with lab.bare() as bare:
        poses = bare.watch("uav/pose")
        goal = goal_from(draw, poses.next()[0]["position"])
        ask(bare, goal)
        poses.until(lambda p: speed(p) > 1)
        pids = [lab.nodes()[name]["pid"] for name in nodes]
        held = time.monotonic()
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        eventually(lambda: time.monotonic() > held + 2.0)
        for pid in pids:
            os.kill(pid, signal.SIGCONT)
        # A hub that was away has lost sessions: another one, as a user's next command.
    with lab.bare() as after:
        poses, states = after.watch("uav/pose"), after.watch("uav/safety/state")
        stopped = states.until(lambda s: s["state"] == "HOVERING", within=10)
        assert stopped["reason"], nodes
        place = poses.until(lambda p: speed(p) < 0.05, within=10)["position"]
        assert all(gap(p["position"], place) < 0.1 for p in poses.next(100))
        assert after.state()["state"] == "HOVERING"
        assert farthest(poses) <= MARGIN
        after.fly(0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def patient() -> Iterator[Lab]:
    """One whose supervisor restarts nobody meanwhile: what ends a flight is the silence."""
    with private_lab() as made:
        made.start("--set", "dynamics.start.z=1", "--set", "supervise.answer_timeout=30")
        yield made


@pytest.mark.parametrize(
    "nodes", [["dynamics"], ["safety"], ["hub"], ["hub", "dynamics", "safety"]]
)
def test_an_outage_beyond_the_grace_ends_the_flight(patient: Lab, nodes: list[str]):
    outage(patient, nodes, random.Random(1))


@pytest.mark.prove
@pytest.mark.timeout(3600)
def test_a_hundred_outages_beyond_the_grace(patient: Lab, proofs: Proofs):
    draw = random.Random(3)
    for _ in range(100):
        outage(patient, draw.choice([["dynamics"], ["safety"], ["hub"], NODES]), draw)
    proofs.add(
        "100 flights with an outage of 2 s", "each ended with its reason, none went on by itself",
        "each",
    )  # fmt: skip
