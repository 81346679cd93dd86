"""Cost of the hovering system, and of the same messages alone on the peers."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

from benchmarks import proc, ros
from benchmarks.bars import Side
from benchmarks.children import PYTHON, process
from benchmarks.effort import Effort
from benchmarks.ours.node import pose
from benchmarks.results import Results
from benchmarks.system import home, running
from quadctl.schemas.messages import Position, Pressure, Setpoint
from quadctl.services.runtime.bus import codec
from quadctl.services.runtime.bus.session import TWO_THREADS

Processes = Callable[[], dict[int, str]]
"""Function that returns the processes of a side: names by pid."""

_SETTLED = 10.0
"""Time (s) from launch in which the vehicle takes off and comes to rest."""


def measure(results: Results, effort: Effort) -> None:
    """Measure processor time and memory of all processes, each side in turn."""
    sides: dict[Side, Callable[[], AbstractContextManager[Processes]]] = {
        "ours": _ours,
        "raw": _raw,
    }
    if why := ros.absent():
        results.missing(["hover_processor", "system_memory"], "ros", why)
    else:
        sides["ros"] = _ros
    for run in range(effort.runs):
        for side, started in sides.items():
            with started() as processes:
                time.sleep(_SETTLED)
                names, began = processes(), time.monotonic()
                before = proc.busy_of(names)
                time.sleep(effort.seconds)
                passed, after = time.monotonic() - began, proc.busy_of(names)
                share = {n: 100 * (after[pid] - before[pid]) / passed for pid, n in names.items()}
                memory = {name: proc.pss(pid) for pid, name in names.items()}
            results.add("hover_processor", side, [sum(share.values())], run)
            results.add("system_memory", side, [sum(memory.values())], run)
            results.notes[f"hover_processor, {side}"] = share
            results.notes[f"system_memory, {side}"] = memory


@contextmanager
def _ours() -> Iterator[Processes]:
    with running() as where:
        yield where.processes


@contextmanager
def _raw() -> Iterator[Processes]:
    with home() as where, ExitStack() as stack:
        Path(where.endpoint.partition("/")[2]).parent.mkdir(parents=True)
        bare = [*PYTHON, "benchmarks.raw.traffic", where.endpoint]
        threads = where.environment | {"ZENOH_RUNTIME": TWO_THREADS}
        hub = stack.enter_context(process([*bare, "hub", "0"], threads))
        started = {hub.pid: "hub"} | {
            stack.enter_context(process([*bare, role, str(size)], where.raw)).pid: role
            for role, size in _sizes().items()
        }
        yield lambda: started


@contextmanager
def _ros() -> Iterator[Processes]:
    with home() as where, ros.master(where.folder / "ros") as graph, ExitStack() as stack:
        started = {
            stack.enter_context(process(graph.traffic(role, size), graph.environment)).pid: role
            for role, size in _sizes().items()
        }
        yield lambda: {pid: f"of roscore, {pid}" for pid in graph.pids()} | started


def _sizes() -> dict[str, int]:
    """Return the size (bytes) of each periodic message of our nodes."""
    place = Position(1.25, -2.5, 1.0625)
    return {
        "vehicle": len(codec.encode(pose(1000))),
        "monitor": len(codec.encode(Setpoint("0123456789abcdef", 1000, place, brake=False))),
        "sensor": len(codec.encode(Pressure(1000.0, 0.25, 1013.25, 10, 1e-5))),
    }
