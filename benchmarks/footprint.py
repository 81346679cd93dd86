"""Memory, processor time, and the time until a dead node leaves the listings."""

import itertools
import os
import signal
import subprocess
import time
from contextlib import ExitStack

from benchmarks import proc, ros
from benchmarks.children import PYTHON, Failed, process, workers
from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.system import QUADCTL, Home, hub, running

_CORNERS = ((2, 0, 1), (2, 2, 1.5), (0, 2, 1), (0, 0, 1))
_LEG_SECONDS = 2.5
_SETTLED = 10.0
"""Time (s) from launch in which the vehicle takes off and comes to rest."""
_QUICK_DEATH = 2.2
"""Shortest life (s) of a node; the supervisor counts an earlier death as a fault at start."""


def measure_flight(results: Results, effort: Effort) -> None:
    """Measure the processor time of the system in flight, and the memory of its nodes."""
    with running() as where:
        time.sleep(_SETTLED)
        flight = shares(where, effort.seconds, fly=True)
        memory = {name: proc.pss(pid) for pid, name in where.processes().items()}
    results.notes["flight_processor"] = flight
    results.add("flight_processor", "ours", [sum(flight.values())])
    results.add("node_memory", "ours", [max(memory.values())])


def measure_nodes(results: Results, _effort: Effort) -> None:
    """Measure the memory of a node that shares no pages with a sibling, and of a rospy node."""
    with ExitStack() as stack:
        where = stack.enter_context(hub())
        pressure = [*PYTHON, "quadctl.services.pressure"]
        alone = stack.enter_context(process(pressure, where.environment))
        if why := ros.absent():
            results.missing(["node_memory", "lone_memory"], "ros", why)
        else:
            graph = stack.enter_context(ros.master(where.folder / "ros"))
            peer = stack.enter_context(process(graph.lab(), graph.environment))
            graph.wait(["rosservice", "list"], "/toggle_cage")
            time.sleep(1.0)
            results.add("node_memory", "ros", [proc.pss(peer.pid)])
            results.add("lone_memory", "ros", [proc.pss(peer.pid)])
        _listed(where, "pressure")
        results.add("lone_memory", "ours", [proc.pss(alone.pid)])


def measure_gone(results: Results, effort: Effort) -> None:
    """Measure the time from `kill -9` of a node until bare Zenoh reports all its tokens as gone."""
    with running() as where:
        watcher = [*PYTHON, "benchmarks.raw.watcher", where.endpoint, "uav/@node/pressure/**"]
        with workers((watcher, where.raw)) as (seen,):
            for _ in range(effort.kills):
                deadline = time.monotonic() + 10
                while not seen.ask("count"):
                    if time.monotonic() > deadline:
                        raise Failed("the killed node does not come back")
                    time.sleep(0.02)
                time.sleep(_QUICK_DEATH)
                pid = where.nodes()["pressure"]["pid"]
                killed = time.monotonic()
                os.kill(pid, signal.SIGKILL)
                results.seconds("gone", "ours", [seen.ask("gone", since=killed)])


def shares(where: Home, seconds: float, *, fly: bool) -> dict[str, float]:
    """Return each process's share of one core (%) while the vehicle hovers or flies."""
    names = where.processes()
    before, began = proc.busy_of(names), time.monotonic()
    corners = itertools.cycle(_CORNERS)
    while (left := began + seconds - time.monotonic()) > 0:
        if fly:
            goal = [str(value) for value in next(corners)]
            subprocess.run(
                [QUADCTL, "goto", "--no-wait", "--replace", *goal],
                env=where.environment, stdout=subprocess.DEVNULL, check=True,
            )  # fmt: skip
        time.sleep(min(left, _LEG_SECONDS))
    passed, after = time.monotonic() - began, proc.busy_of(names)
    return {name: 100 * (after[pid] - before[pid]) / passed for pid, name in names.items()}


def _listed(where: Home, node: str) -> None:
    watcher = [*PYTHON, "benchmarks.raw.watcher", where.endpoint, f"uav/@node/{node}"]
    with workers((watcher, where.raw)) as (seen,):
        deadline = time.monotonic() + 10
        while not seen.ask("count"):
            if time.monotonic() > deadline:
                raise Failed(f"{node} does not come up")
            time.sleep(0.02)
