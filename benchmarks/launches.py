"""How long the system takes to come up and to go, and whether it leaves anything behind."""

import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.figure import Figure, figure
from benchmarks.system import QUADCTL, alive, gone_after, home, pids, quadctl

_LONGEST = 10.0


def measure(runs: int, cycles: int) -> Iterator[Figure]:
    """Every figure of this file."""
    with home() as environment:
        launches = []
        for _ in range(runs + 1):
            began = time.perf_counter()
            quadctl(environment, "up", "-d")
            launches.append(time.perf_counter() - began)
            quadctl(environment, "down")
        yield figure("`up -d` until all four processes answer", "s", 0.3, launches[1:])
        yield figure(
            "Ctrl-C until nothing is left", "s", 0.5, [interrupt(environment) for _ in range(runs)]
        )
        yield figure(
            "`kill -9` of `up` until no process is left", "s", 2.0,
            [orphan(environment) for _ in range(runs)],
        )  # fmt: skip
        left = [leftovers(environment) for _ in range(cycles)]
        yield figure("processes and files left by a start and stop", "", 0, left)


def foreground(environment: dict[str, str]) -> subprocess.Popen[bytes]:
    """A run in the foreground, ready."""
    run = subprocess.Popen([*QUADCTL, "up"], env=environment, stdout=subprocess.DEVNULL)
    deadline = time.perf_counter() + _LONGEST
    while time.perf_counter() < deadline:
        try:
            if '"starting"' not in quadctl(environment, "status", "--json"):
                return run
        except subprocess.CalledProcessError:
            continue
    raise TimeoutError("the run does not come up")


def interrupt(environment: dict[str, str]) -> float:
    """Seconds from Ctrl-C until the last process is gone."""
    run = foreground(environment)
    found = pids(environment)
    began = time.perf_counter()
    run.send_signal(signal.SIGINT)
    run.wait(_LONGEST)
    gone_after(found, _LONGEST)
    return time.perf_counter() - began


def orphan(environment: dict[str, str]) -> float:
    """Seconds from the supervisor's death until the last of its children is gone."""
    run = foreground(environment)
    found = pids(environment)
    run.kill()
    run.wait()
    return gone_after(found, _LONGEST)


def leftovers(environment: dict[str, str]) -> float:
    """How many processes and files a start and a stop leave behind."""
    quadctl(environment, "up", "-d")
    found = pids(environment)
    quadctl(environment, "down")
    left = sum(alive(pid) for pid in found)
    folder = Path(environment["XDG_RUNTIME_DIR"]) / "quadctl"
    return float(left + sum(1 for _ in folder.iterdir()))
