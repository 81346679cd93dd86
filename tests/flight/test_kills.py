"""kill -9 or SIGSTOP of any process at any moment of a flight: a hover, no way out of the cage, and back
by itself.

After a kill the vehicle brakes in time: its speed is highest within the promised time. Behind a killed
hub no pose arrives, and the vehicle gathers speed again when the hub is back within the grace, so the
vehicle's log is timed instead. A hub that is back before setpoints are due again leaves nothing to brake
for: then the flight must arrive, and the outage that safety logged must be as short. After a kill of the
vehicle's process the time until safety reports the stop counts. A frozen hub hides the vehicle: it must be at rest when
it is seen again.

The times assume that a process which is due to run does run. A thread that only sleeps measures how long
the machine kept it from running, and the times are judged without these stalls.
"""

import random
import re
import signal
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.support.bare import Bare, gap, speed
from tests.support.lab import PATIENT, Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import eventually
from tests.support.sleeper import Sleeper

SETPOINT_AGE = 0.15
"""The age (s) at which a setpoint no longer counts."""
SETPOINT_PERIOD = 0.05
"""The period (s) of setpoints: safety measures an outage by its poses, and no finer than that."""
PROMISED = {"dynamics": 0.3, "safety": SETPOINT_AGE + 0.3, "hub": SETPOINT_AGE + 0.3}
"""Within how many seconds the vehicle is to brake, or safety to say so."""
MARGIN = 0.01
"""What a vehicle may be out of the cage, m."""
CAGE = {"x": (-5, 5), "y": (-5, 5), "z": (0, 5)}


@pytest.fixture(scope="module")
def caged() -> Iterator[Lab]:
    """A flying system as it is launched without any setting."""
    with private_lab() as made:
        made.start("--set", "dynamics.start.z=1")
        yield made


@pytest.fixture(scope="module")
def patient() -> Iterator[Lab]:
    """The same on a machine that has much else to do."""
    with private_lab() as made:
        slow = ("--set", "supervise.answer_timeout=3")
        made.start("--set", "dynamics.start.z=1", *PATIENT, *slow)
        yield made


@pytest.mark.timeout(180)
def test_five_kills(patient: Lab):
    # How soon it brakes is judged by the full count, on a machine with nothing else to do. In turn,
    # because one that dies five times within seconds is left down.
    for seed in range(5):
        for node in (*PROMISED, "pressure"):
            kill_in_flight(patient, node, seed)


@pytest.mark.parametrize("node", PROMISED)
def test_a_freeze(patient: Lab, node: str):
    kill_in_flight(patient, node, 0, signal.SIGSTOP)


@pytest.mark.prove
@pytest.mark.timeout(1500)
def test_a_hundred_kills(caged: Lab, proofs: Proofs):
    late, stalls = hundred(caged, [*PROMISED, "pressure"], signal.SIGKILL)
    for node, promised in PROMISED.items():
        tell(proofs, f"`kill -9` of {node}", late[node], promised, stalls)
    assert all(max(late[node]) <= promised for node, promised in PROMISED.items())


@pytest.mark.prove
@pytest.mark.timeout(1500)
def test_a_hundred_freezes(caged: Lab, proofs: Proofs):
    late, stalls = hundred(caged, [*PROMISED], signal.SIGSTOP)
    seen = {node: PROMISED[node] for node in PROMISED if node != "hub"}
    for node, promised in seen.items():
        tell(proofs, f"SIGSTOP of {node}", late[node], promised, stalls)
    proofs.add(
        "SIGSTOP of hub in flight: the vehicle, when it is seen again",
        f"stands, every time (n {len(late['hub'])}); never out of the cage",
        "stands",
    )
    assert all(max(late[node]) <= promised for node, promised in seen.items())


def hundred(lab: Lab, nodes: list[str], number: int) -> tuple[dict[str, list[float]], str]:
    """Each in its turn; returns what was seen of each, and of the machine."""
    sleeper = Sleeper()
    late: dict[str, list[float]] = {node: [] for node in nodes}
    for seed in range(100):
        node = nodes[seed % len(nodes)]
        killed, took = kill_in_flight(lab, node, 1000 + seed, number, judged=True)
        late[node].append(took - sleeper.within(killed, killed + took))
    return late, sleeper.stop()


def tell(proofs: Proofs, what: str, late: list[float], promised: float, stalls: str) -> None:
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
    """Kill a process under way; returns when, and after how many s the flight was on its way to a hover.

    Frozen, it is the supervisor who kills it, after seconds. Holds that the vehicle stays in the cage,
    and that the next flight goes as if nothing had been.
    """
    behind_a_hub = judged and (node, number) == ("hub", signal.SIGKILL)
    draw = random.Random(f"{node} {seed}")
    with lab.bare() as bare:
        poses, states = bare.watch("uav/pose"), bare.watch("uav/safety/state")
        begin(bare, draw)
        poses.until(lambda p: speed(p) > 0.1)
        time.sleep(draw.uniform(0, 1.1))
        last, old = poses.next()[0], lab.nodes()[node]["pid"]
        seen, killed = len(states.messages), time.monotonic()
        logged = len(lab.log("dynamics")), len(lab.log("safety"))
        lab.signal(node, number)
        stopped = killed
        if node == "dynamics":
            states.until(lambda s: s["state"] == "HOVERING", within=5)
            stopped = time.monotonic()
        elif behind_a_hub and eventually(lambda: braked_or_arrived(lab, logged)) == "braked":
            stopped = time.monotonic()
        lab.revived(node, old)
    eventually(lab.is_ready)
    with lab.bare() as after:
        if node != "dynamics":
            flown = after.watch("uav/pose")
            if (node, number) == ("hub", signal.SIGSTOP):
                assert speed(flown.next()[0]) < 0.05, "it has not stopped"
            flown.until(lambda p: speed(p) < 0.05, within=20)
            poses.messages += flown.messages
        assert seen <= len(states.messages)
        assert max(map(speed, poses.messages)) > 0.1, "it never flew"
        for pose in poses.messages:
            assert all(
                low - MARGIN <= pose["position"][axis] <= high + MARGIN
                for axis, (low, high) in CAGE.items()
            ), (node, seed, pose)
        after.fly(0.0, 0.0, 1.0)
    if node == "dynamics" or behind_a_hub:
        return killed, stopped - killed
    return killed, time_of_peak(poses.messages, last)


def braked_or_arrived(lab: Lab, logged: tuple[int, int]) -> str:
    """Return how the flight behind a killed hub went on, by the logs since; empty as long as it is open."""
    # In this order: the vehicle logs its brake before safety logs the outage.
    safety, dynamics = lab.log("safety")[logged[1] :], lab.log("dynamics")[logged[0] :]
    if "braking to a hover" in dynamics:
        return "braked"
    outages = [float(seconds) for seconds in re.findall(r"heard nothing for ([\d.]+) s", safety)]
    assert all(outage <= SETPOINT_AGE + SETPOINT_PERIOD for outage in outages), (outages, dynamics)
    return "arrived" if "State: HOVERING\n" in safety else ""


def begin(bare: Bare, draw: random.Random) -> None:
    """Under way to somewhere far off, as likely as not at the wall."""
    here = bare.watch("uav/pose").next()[0]["position"]
    while True:
        goal = {
            axis: draw.choice((low, high)) if draw.random() < 0.3 else draw.uniform(low, high)
            for axis, (low, high) in CAGE.items()
        }
        if gap(goal, here) > 3:
            break
    assert bare.call("goto", **goal, replace=True).value == {"accepted": True, "reason": ""}


def time_of_peak(poses: list[dict[str, Any]], last: dict[str, Any]) -> float:
    """How long after a pose the vehicle was fastest, simulated s, until it stood; 0 where never more."""
    later = [p for p in poses if p["boot"] == last["boot"] and p["stamp"] >= last["stamp"]]
    fastest = max(later, key=lambda p: (round(speed(p), 3), -p["stamp"]))
    return float(fastest["stamp"] - last["stamp"])
