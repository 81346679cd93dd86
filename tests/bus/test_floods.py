"""Floods of one vehicle, by a student through the gate and from this machine: the others fly on."""

import json
import sys
import time
from collections.abc import Iterator
from itertools import pairwise, product
from pathlib import Path

import msgspec
import pytest
import zenoh

from quadctl.services.runtime.bus.session import free_port
from tests.support.flooder import SERVICES
from tests.support.intruder import session
from tests.support.lab import Lab, private_lab
from tests.support.running import eventually

FLOOD = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[2])!r})
from tests.support.flooder import main
main(*sys.argv[1:])
"""


class Flooded:
    """Run of two vehicles, of which `uav0` may be flooded by a student."""

    def __init__(self, lab: Lab, *settings: str) -> None:
        self.lab = lab
        for words in ("init", "issue hub", "issue student anna --vehicle uav0"):
            assert lab.quadctl("keys", *words.split()).code == 0
        gate = f"tls/127.0.0.1:{free_port()}"
        lab.start(
            "--vehicles", 2, "--listen", gate, "--identity", "keys/hub",
            "--set", "dynamics.start.z=1", *settings,
        )  # fmt: skip
        local = f"unixsock-stream/{lab.home}/hub.sock"
        self.doors = {"gate": (gate, "keys/anna"), "here": (local, "")}

    def flood(self, door: str, kind: str) -> tuple[dict[str, int], list[float]]:
        """Flood while the other vehicle flies there and back.

        Return how the calls ended, and how much later (s) than a period each of the other's poses
        came after the one before, in order.
        """
        poses: list[tuple[float, float]] = []

        def on_pose(sample: zenoh.Sample) -> None:
            stamp = msgspec.msgpack.decode(sample.payload.to_bytes())["stamp"]
            poses.append((time.monotonic(), stamp))

        with session(self.doors["here"][0], Path()) as watching:
            watching.declare_subscriber(
                "uav1/pose", zenoh.handlers.Callback(on_pose, indirect=False)
            )
            ended = self._flood(door, kind)
        late = [now - then - (stamp - before) for (then, before), (now, stamp) in pairwise(poses)]
        return ended, sorted(late)

    def _flood(self, door: str, kind: str) -> dict[str, int]:
        endpoint, identity = self.doors[door]
        flooder = self.lab.spawn(sys.executable, "-c", FLOOD, endpoint, kind, "uav0", identity)
        for x in (4, 1):
            done = self.lab.quadctl("goto", x, 1, 1, "--vehicle", "uav1", "--timeout", 60)
            assert done.code == 0, done.err
        assert flooder.wait() == 0, flooder.log
        ended: dict[str, int] = json.loads(flooder.log.splitlines()[-1])
        # Nothing was killed, and the flooded vehicle obeys again.
        assert [node["restarts"] for node in self.lab.nodes().values()] == [0] * 5
        assert eventually(lambda: self.lab.quadctl("hold", "--vehicle", "uav0").code == 0)
        return ended


P99, MOST = 0.05, 0.2
"""Lateness (s) of another vehicle's poses that is promised: of 99 in 100, and of each."""
LONGEST = 1.0
"""In lock-step the clock itself waits for safety, which has read the calls before the pose."""


def check(late: list[float], most: float = MOST) -> None:
    """Check the lateness (s) of the poses, in order."""
    assert late[int(0.99 * len(late))] <= P99
    assert late[-1] <= most


KINDS = ("later", "at once", "again")


@pytest.fixture(scope="module", params=["false", "true"], ids=["real time", "lock-step"])
def run(request: pytest.FixtureRequest) -> Iterator[tuple[Flooded, bool]]:
    with private_lab() as lab:
        stepped = request.param == "true"
        yield Flooded(lab, "--set", f"dynamics.lockstep={request.param}"), stepped


@pytest.mark.prove
@pytest.mark.alone  # real-time flights of other tests would pay for it
@pytest.mark.parametrize(("door", "kind"), [("gate", "later"), *product(["here"], KINDS)])
def test_20_000_scheduled_calls_disturb_no_other_vehicle(
    run: tuple[Flooded, bool], door: str, kind: str
):
    flooded, stepped = run
    ended, late = flooded.flood(door, kind)
    check(late, LONGEST if stepped else MOST)
    assert sum(ended.values()) == 20_000
    assert ended.keys() <= {"ok", "refused", "unanswered"}
    assert stepped or "ok" not in ended


@pytest.mark.prove
@pytest.mark.alone  # it looks at the lateness of poses
@pytest.mark.parametrize("door", ["gate", "here"])
def test_a_far_call_to_each_service_disturbs_no_other_vehicle(run: tuple[Flooded, bool], door: str):
    flooded, stepped = run
    ended, late = flooded.flood(door, "far")
    check(late)
    assert sum(ended.values()) == len(SERVICES)
    # A call that its role may not make has no answer. One for the next day waits, until its deadline.
    waits = {"expired", "not_ready"} if stepped else {"refused"}
    assert ended.keys() <= waits | ({"unanswered"} if stepped or door == "gate" else set())


@pytest.mark.prove
@pytest.mark.alone  # real-time flights of other tests would pay for it
@pytest.mark.parametrize("door", ["gate", "here"])
def test_40_000_positions_a_second_disturb_no_other_vehicle(run: tuple[Flooded, bool], door: str):
    flooded, stepped = run
    sent, late = flooded.flood(door, "positions")
    check(late, LONGEST if stepped else MOST)
    assert sent["sent"] > 20_000
    log = flooded.lab.log("safety")
    assert log.count("came faster than they were handled and were dropped; the newest 10 wait") == 1
