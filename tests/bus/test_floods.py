"""Floods of one vehicle, by a student through the gate and from this machine: the others fly on."""

import json
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest

from quadctl.services.runtime.bus.session import free_port
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

    def flood(self, door: str, kind: str) -> dict[str, int]:
        """Flood while the other vehicle flies there and back, and return how the calls ended."""
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


KINDS = ("later", "at once", "again")


@pytest.fixture(scope="module", params=["false", "true"], ids=["real time", "lock-step"])
def run(request: pytest.FixtureRequest) -> Iterator[tuple[Flooded, bool]]:
    with private_lab() as lab:
        stepped = request.param == "true"
        yield Flooded(lab, "--set", f"dynamics.lockstep={request.param}"), stepped


@pytest.mark.prove
@pytest.mark.alone  # real-time flights of other tests would pay for it
@pytest.mark.parametrize(("door", "kind"), [("gate", "later"), *product(["here"], KINDS)])
def test_3000_scheduled_calls_disturb_no_other_vehicle(
    run: tuple[Flooded, bool], door: str, kind: str
):
    flooded, stepped = run
    ended = flooded.flood(door, kind)
    assert sum(ended.values()) == 3_000
    assert ended.keys() <= {"ok", "refused", "unanswered"}
    assert stepped or "ok" not in ended


@pytest.mark.prove
@pytest.mark.alone  # real-time flights of other tests would pay for it
@pytest.mark.parametrize("door", ["gate", "here"])
def test_40_000_positions_a_second_disturb_no_other_vehicle(run: tuple[Flooded, bool], door: str):
    flooded, _ = run
    assert flooded.flood(door, "positions")["sent"] > 20_000
    log = flooded.lab.log("safety")
    assert log.count("came faster than they were handled and were dropped; the newest 10 wait") == 1
