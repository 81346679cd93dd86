"""kill -9 or SIGSTOP of any process at a random moment of a flight: the vehicle hovers, stays in the
cage, and the system recovers by itself.

Which time is judged depends on the killed process:

- safety: until the vehicle is fastest; after that moment it only brakes.
- hub, killed: until the vehicle logs that it brakes. No pose arrives without a hub, and the vehicle
  gathers speed again if the hub is back within the grace. If the hub is back before the next setpoint
  is due, there is nothing to brake for: then the flight must arrive, and the outage that safety logged
  must be as short.
- dynamics: until safety reports that the flight has stopped.
- hub, frozen: no time. The vehicle must be at rest when its poses arrive again.

The times assume that the machine runs each process that is ready. Threads that only sleep, one on
each processor, measure their own delays, and the judged times are reduced by them.
"""

import random
import re
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any

import pytest

from tests.support.bare import Bare, Watch, gap, speed
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import eventually
from tests.support.sleeper import Sleeper

SETPOINT_AGE = 0.15
"""Age (s) at which a setpoint expires."""
SETPOINT_PERIOD = 0.05
"""Period (s) of setpoints, the finest resolution of an outage that safety measures by its poses."""
PROMISED = {"dynamics": 0.3, "safety": SETPOINT_AGE + 0.3, "hub": SETPOINT_AGE + 0.3}
"""Seconds within which the vehicle must brake, or safety must report it."""
MARGIN = 0.01
"""Allowed excursion out of the cage, m."""
CAGE = {"x": (-5, 5), "y": (-5, 5), "z": (0, 5)}


@pytest.fixture(scope="module")
def patient() -> Iterator[Lab]:
    """Flying system with long timeouts, for a busy machine."""
    with private_lab() as made:
        start_patient(made)
        yield made


def start_patient(lab: Lab) -> None:
    lab.start("--set", "dynamics.start.z=1", *PATIENT, "--set", "supervise.answer_timeout=3")


@pytest.mark.parametrize("node", [*PROMISED, pytest.param("pressure", marks=pytest.mark.thorough)])
def test_a_killed_node_restarts_and_the_vehicle_stays_in_the_cage(patient: Lab, node: str):
    # The braking time is judged only by the full count, on an idle machine.
    kill_in_flight(patient, node, 0)


@pytest.mark.thorough
def test_nodes_killed_again_and_again_restart_and_the_vehicle_stays_in_the_cage():
    def kill_each(lab: Lab, seed: int) -> None:
        start_patient(lab)
        for node in (*PROMISED, "pressure"):
            kill_in_flight(lab, node, seed)

    # Side by side: a flight mostly waits.
    with ExitStack() as stack, ThreadPoolExecutor(4) as pool:
        labs = [stack.enter_context(private_lab()) for _ in range(4)]
        list(pool.map(kill_each, labs, range(1, 5)))


@pytest.mark.parametrize(
    "node", ["dynamics", "safety", pytest.param("hub", marks=pytest.mark.thorough)]
)
def test_a_frozen_node_restarts_and_the_vehicle_stays_in_the_cage(patient: Lab, node: str):
    kill_in_flight(patient, node, 0, signal.SIGSTOP)


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(1500)
def test_the_vehicle_brakes_in_time_after_a_hundred_kills(proofs: Proofs):
    late, stalls = kill_a_hundred_times([*PROMISED, "pressure"], signal.SIGKILL)
    for node, promised in PROMISED.items():
        add_proof(proofs, f"`kill -9` of {node}", late[node], promised, stalls)
    assert all(max(late[node]) <= promised for node, promised in PROMISED.items())


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(1500)
def test_the_vehicle_brakes_in_time_after_a_hundred_freezes(proofs: Proofs):
    late, stalls = kill_a_hundred_times([*PROMISED], signal.SIGSTOP)
    seen = {node: PROMISED[node] for node in PROMISED if node != "hub"}
    for node, promised in seen.items():
        add_proof(proofs, f"SIGSTOP of {node}", late[node], promised, stalls)
    proofs.add(
        "SIGSTOP of hub in flight: the vehicle, when it is seen again",
        f"stands, every time (n {len(late['hub'])}); never out of the cage",
        "stands",
    )
    assert all(max(late[node]) <= promised for node, promised in seen.items())


def kill_a_hundred_times(nodes: list[str], number: int) -> tuple[dict[str, list[float]], str]:
    """Kill the nodes of two systems with default settings, side by side, each in turn.

    Return the times of each node, and the stalls of the machine.
    """
    sleeper = Sleeper()
    late: dict[str, list[float]] = {node: [] for node in nodes}

    def kill_fifty_times(lab: Lab, first: int) -> None:
        lab.start("--set", "dynamics.start.z=1")
        for seed in range(first, 100, 2):
            node = nodes[seed // 2 % len(nodes)]
            killed, took = kill_in_flight(lab, node, 1000 + seed, number, judged=True)
            late[node].append(took - sleeper.within(killed, killed + took))

    with ExitStack() as stack, ThreadPoolExecutor(2) as pool:
        labs = [stack.enter_context(private_lab()) for _ in range(2)]
        list(pool.map(kill_fifty_times, labs, range(2)))
    return late, sleeper.stop()


def add_proof(proofs: Proofs, what: str, late: list[float], promised: float, stalls: str) -> None:
    times = sorted(late)
    proofs.add(
        f"{what} in flight: until the vehicle brakes for a hover",
        f"{1000 * times[len(times) // 2]:.0f} ms, at most {1000 * times[-1]:.0f} ms"
        f" (n {len(times)}); never out of the cage; {stalls}",
        f"{1000 * promised:.0f} ms",
    )


def kill_in_flight(
    lab: Lab, node: str, seed: int, number: int = signal.SIGKILL, *, judged: bool = False
) -> tuple[float, float]:
    """Signal a process in flight; return the time of the signal and the s until the vehicle brakes.

    The supervisor kills a frozen process after some seconds. Assert that the vehicle stays in the
    cage, and that the next flight is undisturbed.
    """
    behind_a_hub = judged and (node, number) == ("hub", signal.SIGKILL)
    draw = random.Random(f"{node} {seed}")
    with lab.bare() as bare:
        poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
        start_random_flight(bare, draw)
        poses.until(lambda p: speed(p) > 0.1)
        time.sleep(draw.uniform(0, 1.1))
        flying, old = poses.next()[0], lab.nodes()[node]["pid"]
        seen, killed = len(states.messages), time.monotonic()
        logged = len(lab.log("dynamics")), len(lab.log("safety"))
        lab.signal(node, number)
        stopped, stamp = killed, stamp_at(killed, poses, flying["boot"])
        if node == "dynamics":
            states.until(lambda s: s["state"] == "HOVERING")
            stopped = time.monotonic()
        elif behind_a_hub and eventually(lambda: braked_or_arrived(lab, logged)) == "braked":
            stopped = time.monotonic()
        lab.revived(node, old)
    eventually(lab.is_ready)
    with lab.bare() as after:
        if node != "dynamics":
            flown = after.watch("uav/pose")
            first = flown.next()[0]
            assert first["boot"] == flying["boot"], f"{node} took dynamics along"
            if (node, number) == ("hub", signal.SIGSTOP):
                assert speed(first) < 0.05, "the vehicle has not stopped"
            flown.until(lambda p: speed(p) < 0.05)
            poses.messages += flown.messages
        assert seen <= len(states.messages)
        assert max(map(speed, poses.messages)) > 0.1, "the vehicle never flew"
        for pose in poses.messages:
            assert all(
                low - MARGIN <= pose["position"][axis] <= high + MARGIN
                for axis, (low, high) in CAGE.items()
            ), (node, seed, pose)
        after.fly(0.0, 0.0, 1.0)
    if node == "dynamics" or behind_a_hub:
        return killed, stopped - killed
    return killed, time_of_peak(poses.messages, flying["boot"], stamp)


def braked_or_arrived(lab: Lab, logged: tuple[int, int]) -> str:
    """Return the outcome of the flight from the logs since the kill of the hub, or an empty text so far."""
    # In this order: the vehicle logs its brake before safety logs the outage.
    safety, dynamics = lab.log("safety")[logged[1] :], lab.log("dynamics")[logged[0] :]
    if "braking to a hover" in dynamics:
        return "braked"
    outages = [
        float(seconds) for seconds in re.findall(r"received no setpoint for ([\d.]+) s", safety)
    ]
    assert all(outage <= SETPOINT_AGE + SETPOINT_PERIOD for outage in outages), (outages, dynamics)
    return "arrived" if "State: HOVERING\n" in safety else ""


def start_random_flight(bare: Bare, draw: random.Random) -> None:
    """Start a flight to a random goal over 3 m away, often on a wall."""
    here = bare.watch("uav/pose").next()[0]["position"]
    while True:
        goal = {
            axis: draw.choice((low, high)) if draw.random() < 0.3 else draw.uniform(low, high)
            for axis, (low, high) in CAGE.items()
        }
        if gap(goal, here) > 3:
            break
    assert bare.call("goto", **goal, replace=True).value == {"accepted": True, "reason": ""}


def stamp_at(moment: float, poses: Watch, boot: str) -> float:
    """Return the simulated s at a moment (monotonic s), by the pose that arrived with the least delay.

    The last pose seen before a kill may be older than the kill: this process has to wait for its turn, too.
    """
    arrived = zip(poses.times, list(poses.messages), strict=False)
    return moment - min(at - pose["stamp"] for at, pose in arrived if pose["boot"] == boot)


def time_of_peak(poses: list[dict[str, Any]], boot: str, start: float) -> float:
    """Return the simulated s from a stamp to the peak speed; 0 if the speed never rises after it."""
    later = [p for p in poses if p["boot"] == boot and p["stamp"] >= start]
    fastest = max(later, key=lambda p: (round(speed(p), 3), -p["stamp"]))
    return float(fastest["stamp"] - start)
