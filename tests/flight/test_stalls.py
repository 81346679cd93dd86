"""Processes that stall for a while: a flight pauses, then goes on or ends, depending on the grace.

The tests assume that the machine itself stalls no process for longer than the grace. Threads that only
sleep measure this: they record how late they wake.
"""

import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

from tests.support.bare import Bare, Watch, gap, speed
from tests.support.lab import NODES, PATIENT, Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import eventually
from tests.support.sleeper import Sleeper

FAR, BACK = {"x": 4.5, "y": 0.0, "z": 1.0}, {"x": 0.0, "y": 0.0, "z": 1.0}


@pytest.mark.parametrize(
    "node", ["dynamics", "safety", pytest.param("hub", marks=pytest.mark.thorough)]
)
def test_a_stall_within_the_grace_pauses_the_flight(lab: Lab, node: str):
    # A slow flight lasts longer than a busy machine takes to see that it has begun. Poses that such a
    # machine delays must not look like those that safety's own stall kept waiting.
    patient, seconds = (PATIENT, 1.0) if node == "safety" else ((), 0.5)
    lab.start("--set", "dynamics.start.z=1", "--set", "dynamics.grace=5", *patient,
              "--set", "dynamics.control.max_speed=1", "--set", "supervise.answer_timeout=60")  # fmt: skip
    going = lab.spawn(*lab.command("goto", *FAR.values()))
    with lab.bare() as bare:
        poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
        poses.until(lambda p: speed(p) > 0.8)
        stalled = time.monotonic()
        lab.signal(node, signal.SIGSTOP)
        eventually(lambda: time.monotonic() > stalled + seconds)
        lab.signal(node, signal.SIGCONT)
        state = "MOVING" if node == "safety" else "HOVERING"
        states.until(lambda s: s["state"] == state and "pause" in s["reason"])
        states.until(lambda s: s["state"] == "MOVING" and "went on after a pause" in s["reason"])
        states.until(lambda s: s["state"] == "HOVERING" and s["goal"] == FAR)
    assert going.wait() == 0
    assert ("paused: no pose" in going.log) is (node != "safety")
    assert "arrived" in going.log


@pytest.mark.thorough
def test_a_stall_of_safety_itself_stops_the_flight_with_a_reason(lab: Lab):
    lab.start("--set", "dynamics.start.z=1", "--set", "supervise.answer_timeout=60")
    with lab.bare() as bare:
        states, poses = bare.watch("uav/safety/state"), bare.watch("uav/pose")
        assert bare.call("goto", **FAR).value["accepted"]
        poses.until(lambda p: speed(p) > 1)
        lab.signal("safety", signal.SIGSTOP)
        place = poses.until(lambda p: speed(p) < 0.01)["position"]
        held = time.monotonic()
        eventually(lambda: time.monotonic() > held + 1.0)
        lab.signal("safety", signal.SIGCONT)
        stopped = states.until(lambda s: s["state"] == "HOVERING")
        assert "safety itself was held up for" in stopped["reason"]
        assert all(gap(p["position"], place) < 0.05 for p in poses.next(100))
        assert gap(place, FAR) > 1
    assert lab.quadctl("goto", 4.5, 0, 1).code == 0


@pytest.mark.thorough
def test_setpoints_to_an_abandoned_goal_are_ignored(lab: Lab):
    lab.start("--without", "safety", "--set", "dynamics.start.z=1")
    with lab.bare() as bare:
        poses = bare.watch("uav/pose")
        publish_setpoints(bare, poses, FAR, lambda p: speed(p) > 1)
        place = poses.until(lambda p: speed(p) < 0.01)["position"]
        poses_seen = publish_setpoints(bare, poses, FAR, count=100)
        assert all(gap(pose["position"], place) < 0.05 for pose in poses_seen)
        assert gap(place, FAR) > 1
        publish_setpoints(bare, poses, BACK, lambda p: gap(p["position"], BACK) < 0.1)
        publish_setpoints(bare, poses, FAR, lambda p: gap(p["position"], FAR) < 0.1)
    assert "hovering until a new goal is requested" in lab.log("dynamics")


def publish_setpoints(
    bare: Bare, poses: Watch, goal: dict[str, float], until: Any = None, count: int = 1000
):
    """Answer each pose with a setpoint until `until` holds for a pose, or `count` times."""
    poses_seen = []
    for _ in range(count):
        poses_seen += poses.next()
        told = {"boot": poses_seen[-1]["boot"], "for_seq": poses_seen[-1]["seq"], "position": goal}
        bare.put("uav/input/position", {**told, "brake": False})
        if until and until(poses_seen[-1]):
            return poses_seen
    assert until is None, f"not within {count} poses; the last was {poses_seen[-1]}"
    return poses_seen


@pytest.mark.thorough
def test_any_silence_ends_a_flight_without_grace(lab: Lab):
    lab.start("--set", "dynamics.start.z=1", "--set", "dynamics.grace=0")
    assert lab.quadctl("goto", 1, 0, 1).code == 0
    with lab.bare() as bare:
        poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
        assert bare.call("goto", **FAR).value["accepted"]
        poses.until(lambda p: speed(p) > 1)
        stalled = time.monotonic()
        lab.signal("dynamics", signal.SIGSTOP)
        eventually(lambda: time.monotonic() > stalled + 0.5)
        lab.signal("dynamics", signal.SIGCONT)
        states.until(lambda s: s["state"] == "HOVERING" and s["reason"].endswith("stopped"))


MARGIN = 0.01
CAGE = {"x": (-5, 5), "y": (-5, 5), "z": (0, 5)}


@contextmanager
def stalling(lab: Lab, draw: random.Random, seconds: tuple[float, float]) -> Iterator[list[float]]:
    """Stall a random process of the system, or all of them, every two seconds."""
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


def goal_from(draw: random.Random, here: dict[str, float]) -> dict[str, float]:
    """Return a random goal 1 to 3 m away, often on a wall."""
    while True:
        goal = {
            axis: draw.choice((low, high)) if draw.random() < 0.3 else draw.uniform(low, high)
            for axis, (low, high) in CAGE.items()
        }
        if 1 < gap(goal, here) < 3:
            return goal


def send_goto(bare: Bare, goal: dict[str, float]) -> None:
    answer = bare.call("goto", **goal, replace=True)
    assert answer.value == {"accepted": True, "reason": ""}


def fly(bare: Bare, states: Watch, goal: dict[str, float]) -> str:
    """Fly once; return the reason why the vehicle did not arrive, or an empty text."""
    send_goto(bare, goal)
    ended: dict[str, Any] = states.until(
        lambda s: (
            s["state"] == "HOVERING"
            and not s["reason"].startswith("paused")
            and (s["goal"] == goal or s["reason"] != "")
        )
    )
    return "" if ended["goal"] == goal and not ended["reason"] else str(ended["reason"])


def largest_excursion(poses: Watch) -> float:
    """Return the largest excursion of the vehicle out of the cage, m."""
    return max(
        max(low - pose["position"][axis], pose["position"][axis] - high)
        for pose in poses.messages
        for axis, (low, high) in CAGE.items()
    )


def among_stalls(lab: Lab, count: int, seed: int) -> tuple[list[str], float, int]:
    """Start a system and fly `count` times, at least 20.

    Return the reasons of failed flights, the excursion (m), and the number of stalls.
    """
    lab.start("--set", "dynamics.start.z=1")
    draw, problems, out = random.Random(seed), [], -1.0
    with stalling(lab, random.Random(seed + 1), (0.1, 0.5)) as stalls:
        for _ in range(0, count, 20):
            with lab.bare() as bare:
                poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
                for _ in range(20):
                    here = poses.next()[0]["position"]
                    if why := fly(bare, states, goal_from(draw, here)):
                        problems.append(why)
                out = max(out, largest_excursion(poses))
    assert len(stalls) > count / 5
    return problems, out, len(stalls)


def side_by_side(labs: int, each: int) -> tuple[list[str], float, str]:
    """Fly in several systems at once, as a flight mostly waits; return as `among_stalls`, in words."""
    sleeper = Sleeper()
    with ExitStack() as stack, ThreadPoolExecutor(labs) as pool:
        made = [stack.enter_context(private_lab()) for _ in range(labs)]
        found = list(pool.map(among_stalls, made, [each] * labs, range(labs)))
    problems = [why for whys, _, _ in found for why in whys]
    stalls = sum(count for _, _, count in found)
    return problems, max(out for _, out, _ in found), f"{stalls} stalls of ours; {sleeper.stop()}"


@pytest.mark.thorough
def test_sixty_flights_arrive_despite_short_stalls():
    problems, out, assumed = side_by_side(3, 20)
    assert problems == [], assumed
    assert out <= MARGIN


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(7200)
def test_a_thousand_flights_arrive_despite_short_stalls(proofs: Proofs):
    problems, out, assumed = side_by_side(5, 200)
    proofs.add(
        "1000 flights, a process or all stopped for 0.1 to 0.5 s every 2 s",
        f"{1000 - len(problems)} arrived, at most {1000 * max(out, 0):.1f} mm out of the cage"
        f" ({assumed})",
        "999, 10 mm",
    )
    assert len(problems) <= 1, problems
    assert out <= MARGIN


def outage(lab: Lab, nodes: list[str], draw: random.Random) -> None:
    """Stop processes in flight for 2 s: the flight ends with a reason, and does not resume by itself."""
    with lab.bare() as bare:
        poses = bare.watch("uav/pose")
        goal = goal_from(draw, poses.next()[0]["position"])
        send_goto(bare, goal)
        poses.until(lambda p: speed(p) > 1)
        pids = [lab.nodes()[name]["pid"] for name in nodes]
        held = time.monotonic()
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        eventually(lambda: time.monotonic() > held + 2.0)
        for pid in pids:
            os.kill(pid, signal.SIGCONT)
        # A hub that was away has lost its sessions: use a new one, like a user's next command.
    with lab.bare() as after:
        poses, states = after.watch("uav/pose"), after.watch("uav/safety/state")
        stopped = states.until(lambda s: s["state"] == "HOVERING")
        assert stopped["reason"], nodes
        place = poses.until(lambda p: speed(p) < 0.05)["position"]
        assert all(gap(p["position"], place) < 0.1 for p in poses.next(100))
        assert after.state()["state"] == "HOVERING"
        assert largest_excursion(poses) <= MARGIN
        after.fly(0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def patient() -> Iterator[Lab]:
    """System with a supervisor so patient that it restarts no process: only silence ends a flight."""
    with private_lab() as made:
        start_patient(made)
        yield made


def start_patient(lab: Lab) -> None:
    lab.start("--set", "dynamics.start.z=1", "--set", "supervise.answer_timeout=30")


@pytest.mark.thorough
@pytest.mark.parametrize(
    "nodes", [["dynamics"], ["safety"], ["hub"], ["hub", "dynamics", "safety"]]
)
def test_an_outage_beyond_the_grace_ends_the_flight(patient: Lab, nodes: list[str]):
    outage(patient, nodes, random.Random(1))


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(3600)
def test_a_hundred_outages_beyond_the_grace_end_the_flights(proofs: Proofs):
    def twenty(lab: Lab, seed: int) -> None:
        start_patient(lab)
        draw = random.Random(seed)
        for _ in range(20):
            outage(lab, draw.choice([["dynamics"], ["safety"], ["hub"], NODES]), draw)

    with ExitStack() as stack, ThreadPoolExecutor(5) as pool:
        labs = [stack.enter_context(private_lab()) for _ in range(5)]
        list(pool.map(twenty, labs, range(3, 8)))
    proofs.add(
        "100 flights with an outage of 2 s", "each ended with its reason, none went on by itself",
        "each",
    )  # fmt: skip
