"""Times of launch and end of the system, and leftovers."""

import json
import signal
import subprocess
import time

from benchmarks import ros
from benchmarks.children import Failed, end
from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.system import QUADCTL, Home, alive, gone_after, home

_LONGEST = 20.0


def measure(results: Results, effort: Effort) -> None:
    """Measure launch, Ctrl-C and sudden death, ours and ROS's in turn."""
    if why := ros.absent():
        results.missing(["launch", "interrupt"], "ros", why)
    with home() as where:
        launch(where)
        for number in range(effort.launches):
            results.seconds("launch", "ours", [launch(where)])
            results.seconds("interrupt", "ours", [interrupt(where)])
            results.seconds("orphan", "ours", [orphan(where)])
            if not why and number < effort.ros_launches:
                came, gone = roslaunch(ros.place(where.folder / f"ros{number}"))
                results.seconds("launch", "ros", [came])
                results.seconds("interrupt", "ros", [gone])


def measure_leftovers(results: Results, effort: Effort) -> None:
    """Count the leftovers of many starts and stops; one is too many, so the figure is their sum."""
    with home() as where:
        left = [what for _ in range(effort.cycles) for what in leftovers(where)]
    results.add("leftovers", "ours", [float(len(left))])
    for what in sorted(set(left)):
        results.notes.setdefault("leftovers", {})[what] = float(left.count(what))


def launch(where: Home) -> float:
    """Return the time (s) of `up -d`, which returns when all answer; then stop the run."""
    began = time.perf_counter()
    try:
        where.quadctl("up", "-d")
        return time.perf_counter() - began
    finally:
        where.quadctl("down")


def foreground(where: Home) -> subprocess.Popen[bytes]:
    """Start a run in the foreground, and wait until it is ready."""
    run = subprocess.Popen(
        [QUADCTL, "up"], env=where.environment, stdout=subprocess.DEVNULL, start_new_session=True
    )
    deadline = time.perf_counter() + _LONGEST
    while time.perf_counter() < deadline:
        try:
            if all(node["state"] == "ready" for node in where.nodes().values()):
                return run
        except subprocess.CalledProcessError:
            continue
    end(run)
    raise Failed("the run does not come up")


def interrupt(where: Home) -> float:
    """Return the time (s) from Ctrl-C until the last process is gone."""
    run = foreground(where)
    try:
        found = where.pids()
        began = time.perf_counter()
        run.send_signal(signal.SIGINT)
        run.wait(_LONGEST)
        gone_after(found)
        return time.perf_counter() - began
    finally:
        end(run)


def orphan(where: Home) -> float:
    """Return the time (s) from the supervisor's death until its last child is gone."""
    run = foreground(where)
    try:
        found = where.pids()
        run.kill()
        run.wait()
        return gone_after(found)
    finally:
        end(run)


def leftovers(where: Home) -> list[str]:
    """Return the processes and files that exist after a start and a stop when `down` ends."""
    where.quadctl("up", "-d")
    found = where.processes()
    where.quadctl("down")
    left = [name for pid, name in found.items() if alive(pid)]
    return left + [str(path.name) for path in (where.folder / "quadctl").rglob("*")]


def roslaunch(graph: ros.Ros) -> tuple[float, float]:
    """Return the times (s) of a `roslaunch` of five nodes until all publish, and of its Ctrl-C."""
    first = graph.folder / "first.json"
    began = time.monotonic()
    run = subprocess.Popen(
        ["roslaunch", "-p", str(graph.port), "quadctl_bench", "five.launch"],
        env=graph.environment | {"FIRST": str(first)}, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        while not first.exists():
            if time.monotonic() - began > _LONGEST:
                raise Failed("roslaunch: no first messages")
            time.sleep(0.002)
        came = min(json.loads(first.read_bytes()).values()) - began
        interrupted = time.monotonic()
        run.send_signal(signal.SIGINT)
        run.wait(_LONGEST)
        return came, time.monotonic() - interrupted
    finally:
        end(run)
