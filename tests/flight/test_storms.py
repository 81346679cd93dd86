"""Random SIGSTOP and SIGCONT of all processes of a run at once: never out of the cage, and it heals."""

import os
import random
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from tests.flight.test_kills import CAGE, MARGIN, start_patient
from tests.support.bare import pack, speed
from tests.support.lab import NODES, Lab
from tests.support.proofs import Proofs
from tests.support.running import eventually

LONGEST = 1.5
"""Seconds of the longest stop; the supervisor kills a process that is silent for 3 s."""


def test_a_storm_of_stops_never_moves_the_vehicle_out(lab: Lab):
    stops, poses = storm(lab, seconds=5.0, seed=1)
    assert stops > 10
    assert poses > 100


@pytest.mark.prove
@pytest.mark.alone
@pytest.mark.timeout(600)
def test_a_long_storm_of_stops_never_moves_the_vehicle_out(lab: Lab, proofs: Proofs):
    stops, _ = storm(lab, seconds=60.0, seed=2)
    proofs.add(
        "all processes stopped at random for 10 to 1500 ms, for 60 s in flight",
        f"{stops} stops; never out of the cage; healed, no process left stopped",
        "never out",
    )


def storm(lab: Lab, seconds: float, seed: int) -> tuple[int, int]:
    """Stop processes at random during flights; return the numbers of stops and of poses seen."""
    start_patient(lab)
    end, stops = time.monotonic() + seconds, list[str]()
    threads = [
        threading.Thread(target=stop_and_go, args=(lab, name, end, seed, stops))
        for name in ("up", *NODES)
    ]
    for thread in threads:
        thread.start()
    draw, poses = random.Random(seed), list[dict[str, Any]]()
    while time.monotonic() < end:
        poses += flight(lab, draw)
    for thread in threads:
        thread.join()
    eventually(lab.is_ready, 20.0)
    assert not [pid for pid in lab.processes() if is_stopped(pid)]
    # A process that is being replaced may still be ready by its record.
    healed = eventually(lambda: lab.quadctl("goto", 0, 0, 1, "--replace").code == 0, 30.0)
    assert healed
    poses += flight(lab, draw)
    outside = [
        pose
        for pose in poses
        for axis, (low, high) in CAGE.items()
        if not low - MARGIN <= pose["position"][axis] <= high + MARGIN
    ]
    assert not outside, outside[0]
    assert max(map(speed, poses)) > 0.5, "the vehicle never flew"
    return len(stops), len(poses)


def stop_and_go(lab: Lab, name: str, end: float, seed: int, stops: list[str]) -> None:
    draw = random.Random(f"{seed} {name}")
    while time.monotonic() < end:
        status = lab.status()
        pids = {node["name"]: node["pid"] for node in status["nodes"]} | {"up": status["pid"]}
        # The supervisor has no other pid; a node that is down now has none.
        if pid := pids.get(name, 0):
            try:
                os.kill(pid, signal.SIGSTOP)
                stops.append(name)
                time.sleep(draw.uniform(0.01, LONGEST))
                os.kill(pid, signal.SIGCONT)
            except ProcessLookupError:
                pass  # the supervisor has replaced it
        time.sleep(draw.uniform(0.05, 1.0))


def flight(lab: Lab, draw: random.Random) -> list[dict[str, Any]]:
    """Request a goal, often on a wall, and return the poses that came within a second."""
    if (bare := lab.try_bare()) is None:
        return []
    with bare:
        watch = bare.watch("uav/pose")
        goal = {axis: draw.choice(sides) for axis, sides in CAGE.items()}
        replies = bare.send("uav/@srv/goto", pack(goal | {"replace": True}), timeout=1.0)
        list(replies)
        time.sleep(1.0)
        return list(watch.messages)


def is_stopped(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except (FileNotFoundError, ProcessLookupError):
        return False
    return stat.rpartition(")")[2].split()[0] == "T"
