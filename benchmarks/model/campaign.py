"""Time of a campaign, beside the steps of its vehicles alone: `python -m benchmarks.model.campaign`.

Both fly the same number of vehicles for the same simulated time on as many processes as there are
processors, taking turns. The steps alone have neither automaton nor score; their vehicles have a
goal that they do not reach.
"""

import os
import statistics
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

from benchmarks.machine import described
from benchmarks.model.vehicles import flying, send

FLIGHTS, SECONDS, ROUNDS = 10_000, 60.0, 3
BATCH = 500
"""Vehicles in an array, as in a campaign."""


def main() -> None:
    processors = len(os.sched_getaffinity(0))
    whole, alone = [], []
    for _ in range(ROUNDS):
        whole.append(_campaign(processors))
        alone.append(_steps_on(processors))
    ratio = statistics.median(a / b for a, b in zip(whole, alone, strict=True))
    machine = described()
    print(f"{FLIGHTS} flights of {SECONDS:g} s on {processors} processors, median of {ROUNDS}:")
    print(f"campaign         {statistics.median(whole):6.2f} s  ({_list(whole)})")
    print(f"steps alone      {statistics.median(alone):6.2f} s  ({_list(alone)})")
    print(f"ratio            {ratio:6.2f}")
    print(f"{machine['processor']}; Python {machine['python']}; load {machine['load']}")


def _campaign(processors: int) -> float:
    words = ("campaign", "--flights", FLIGHTS, "--seconds", SECONDS, "--processes", processors)
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, "-P", "-m", "quadctl.cli.main", *map(str, words), "--json"],
        stdout=subprocess.DEVNULL,
        check=True,
    )
    return time.perf_counter() - began


def _steps_on(processors: int) -> float:
    """Return the longest time that one of several processes needs for its share of the steps."""
    command = [sys.executable, "-m", __spec__.name, str(FLIGHTS // processors)]

    def run(_: int) -> float:
        return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)

    with ThreadPoolExecutor(processors) as pool:
        return max(pool.map(run, range(processors)))


def steps(count: int) -> float:
    """Return the time (s) to fly vehicles without anything that watches them."""
    from benchmarks.model import alone
    from quadctl.services.dynamics.compiled.fleet import CompiledFleet

    module, took = alone.compiled(), 0.0
    for first in range(0, count, BATCH):
        fleet = CompiledFleet([flying()] * min(BATCH, count - first), module)
        send(fleet.goto, min(BATCH, count - first))
        fleet.fly(4)
        began = time.perf_counter()
        for _ in range(round(20 * SECONDS)):
            fleet.fly(50)
        took += time.perf_counter() - began
    return took


def _list(times: list[float]) -> str:
    return ", ".join(f"{each:.2f}" for each in times)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(steps(int(sys.argv[1])))
    else:
        main()
