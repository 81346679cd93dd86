"""Many realms on one machine, isolated from each other, and many vehicles on one hub."""

import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import ceil
from pathlib import Path
from typing import NamedTuple

import pytest
import zenoh

from benchmarks import proc
from tests.support.bare import Bare, Watch, unpack
from tests.support.lab import Lab, private_lab
from tests.support.proofs import Proofs
from tests.support.running import eventually

TELEMETRY = Path(__file__).parents[1] / "support" / "telemetry.py"
LEG = 10.0
"""Seconds from one goal to the next."""
HZ = 20
"""Rate of the poses. 30 realms at the usual 100 Hz take three or four cores."""
SHARED = ("--set", f"dynamics.rate={HZ}", "--set", "dynamics.start.z=1",
          "--set", "safety.pose_timeout=5", "--set", "dynamics.setpoint_timeout=5",
          "--set", "supervise.answer_timeout=30")  # fmt: skip
"""Long timeouts: a process that waits for a shared core must not count as dead."""


class Load(NamedTuple):
    """Load of the processes: % of one core, and MB of memory, shared pages counted once."""

    processor: float
    memory: float


class Realm(NamedTuple):
    """One realm of many, and all that a third-party session on its hub received."""

    name: str
    bare: Bare
    poses: Watch
    states: Watch


def test_three_realms_receive_nothing_from_each_other():
    with realms(3) as (lab, started):
        fly(lab, started, 2.0)


@pytest.mark.prove
@pytest.mark.alone
def test_thirty_realms_for_a_minute_receive_nothing_from_each_other(proofs: Proofs):
    with realms(30) as (lab, started):
        rates, received, load = fly(lab, started, 60.0)
    proofs.add(
        "30 realms side by side for a minute, each flying to its own goals: what belongs to another",
        f"0 of {received} messages; poses of {HZ} Hz at {min(rates):.1f} to {max(rates):.1f} Hz;"
        f" {load.processor:.0f} % of a core, {load.memory:.0f} MB",
        "none",
    )


@contextmanager
def realms(count: int) -> Iterator[tuple[Lab, list[Realm]]]:
    """Start `count` complete systems in one folder, each with its vehicle in the air."""
    with private_lab() as lab, ExitStack() as stack:
        names = [f"realm{number}" for number in range(count)]
        stack.callback(lab.each, [f"down --realm {name}" for name in names])
        for name in names:
            done = lab.quadctl("up", "-d", "--realm", name, *SHARED, timeout=60.0)
            assert done == (0, f"realm {name} is up\n", "")
        found = []
        for name in names:
            hub = lab.home.with_name(name) / "hub.sock"
            bare = stack.enter_context(Bare(f"unixsock-stream/{hub}"))
            found.append(Realm(name, bare, bare.watch("*/pose"), bare.watch("*/safety/state")))
        yield lab, found


def fly(lab: Lab, started: list[Realm], seconds: float) -> tuple[list[float], int, Load]:
    """Fly each realm to its own goals; return the rates (Hz), the number of messages and the load.

    Assert that each session receives one boot and only its own realm's goals.
    """
    goals: dict[str, list[dict[str, float]]] = defaultdict(list)
    for realm in started:
        realm.poses.next()
        goals[realm.name].append(realm.bare.state()["goal"])
    first = {realm.name: len(realm.poses.messages) for realm in started}
    pids, began = lab.processes(), time.monotonic()
    busy = sum(proc.busy_of(pids).values())
    for leg in range(1, 1 + ceil(seconds / LEG)):
        for number, realm in enumerate(started):
            goal = {"x": number / 10, "y": leg / 10, "z": 1.0 + (leg % 2)}
            answer = realm.bare.call("goto", **goal, replace=True)
            assert answer.value == {"accepted": True, "reason": ""}
            goals[realm.name].append(goal)
        time.sleep(max(min(leg * LEG, seconds) + began - time.monotonic(), 0))
    passed = time.monotonic() - began
    load = Load(100 * (sum(proc.busy_of(pids).values()) - busy) / passed, sum(map(proc.pss, pids)))
    rates = [(len(realm.poses.messages) - first[realm.name]) / passed for realm in started]
    boots = [{pose["boot"] for pose in realm.poses.messages} for realm in started]
    assert [len(own) for own in boots] == [1] * len(started)
    assert len(set.union(*boots)) == len(started)
    for realm in started:
        assert realm.bare.state()["request"] == len(goals[realm.name]) - 1, (
            "only its own calls are counted"
        )
        assert {state["boot"] for state in realm.states.messages} <= {
            pose["boot"] for pose in realm.poses.messages
        }
        for state in realm.states.messages:
            assert state["reason"] or state["goal"] in goals[realm.name], (realm.name, state)
    received = sum(len(realm.poses.messages) + len(realm.states.messages) for realm in started)
    return rates, received, load


def test_no_telemetry_of_fifty_vehicles_is_lost(lab: Lab):
    telemetry(lab, 50, 2, 3)


@pytest.mark.prove
@pytest.mark.alone
def test_no_telemetry_of_a_thousand_vehicles_is_lost(lab: Lab, proofs: Proofs):
    rates, ages, load = telemetry(lab, 1000, 4, 30)
    proofs.add(
        "telemetry of 1000 vehicles at 1 Hz through one hub: what is lost",
        f"nothing; {min(rates):.3f} to {max(rates):.3f} Hz each; of age"
        f" {1e3 * ages[len(ages) // 2]:.1f} ms, p99 {1e3 * ages[99 * len(ages) // 100]:.1f} ms;"
        f" hub {load.processor:.0f} % of a core, {load.memory:.0f} MB",
        "nothing",
    )


def telemetry(
    lab: Lab, vehicles: int, processes: int, periods: int
) -> tuple[list[float], list[float], Load]:
    """Publish at 1 Hz for each vehicle; return rates (Hz), ages (s) and the hub's load.

    Assert that no message of any vehicle is lost, and that the hub lists all of them.
    """
    lab.start("--without", "dynamics", "--without", "pressure", "--without", "safety")
    received: dict[str, list[tuple[float, int]]] = defaultdict(list)
    ages: list[float] = []

    def on_sample(sample: zenoh.Sample) -> None:
        seq: int = unpack(sample.payload.to_bytes())["seq"]
        received[str(sample.key_expr).partition("/")[0]].append((time.monotonic(), seq))
        if sample.timestamp is not None:
            ages.append(time.time() - sample.timestamp.get_time().timestamp())

    with lab.bare() as bare:
        subscriber = bare.session.declare_subscriber("*/pose", on_sample)
        each, endpoint = vehicles // processes, f"unixsock-stream/{lab.home / 'hub.sock'}"
        publishers = [
            lab.spawn(sys.executable, str(TELEMETRY), endpoint, str(n * each), str(each), "1")
            for n in range(processes)
        ]
        hub = lab.nodes()["hub"]["pid"]
        eventually(lambda: len(received) == vehicles, 30.0)
        busy, began = proc.busy_of([hub])[hub], time.monotonic()
        replies = bare.session.liveliness().get("*/@node/*", timeout=10.0)
        assert len([reply for reply in replies if reply.ok]) >= vehicles, (
            "the hub lists all vehicles"
        )
        eventually(
            lambda: min(len(came) for came in received.values()) > periods, 2.0 * periods + 10.0
        )
        load = Load(
            100 * (proc.busy_of([hub])[hub] - busy) / (time.monotonic() - began), proc.pss(hub)
        )
        for process in publishers:
            process.end()
        subscriber.undeclare()
    for name, came in received.items():
        assert [seq for _, seq in came] == list(range(len(came))), name
    rates = [(len(came) - 1) / (came[-1][0] - came[0][0]) for came in received.values()]
    return rates, sorted(ages), load
