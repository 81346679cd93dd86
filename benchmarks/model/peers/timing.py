"""Measurement of speed in any environment. Standard library only."""

import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

COUNTS = (1, 10, 100, 1000, 10_000, 100_000)
"""Numbers of vehicles that step together."""
_ROUNDS = 4
_SECONDS = 0.2
"""Length (s) of one round, about. The best round counts, because other load only slows a round."""

_TURNS = 41
"""Number of slices of each side if two sides alternate."""

Rates = dict[str, dict[int, float]]
"""Vehicle-steps per second of processor time, by mode and number of vehicles."""


def rate(run: Callable[[int], None], vehicle_steps: float) -> float:
    """Return vehicle-steps per second of processor time of `run(calls)`, `vehicle_steps` a call."""
    run(1)  # compiled, loaded, allocated
    calls, seconds = 1, 0.0
    while seconds < _SECONDS:
        seconds = _timed(run, calls)
        if seconds < _SECONDS:
            calls = max(2 * calls, int(calls * _SECONDS / max(seconds, 1e-6)))
    best = min([seconds, *(_timed(run, calls) for _ in range(_ROUNDS))])
    return vehicle_steps * calls / best


def in_turn(ours: Callable[[int], None], theirs: Callable[[int], None]) -> float:
    """Return our speed divided by theirs for calls of equal work: the median of many ratios.

    The two sides of each ratio run directly after each other, in alternating order, so the
    processor's speed, which drifts, is the same for both.
    """
    sides = [ours, theirs]
    for run in sides:
        run(1)
    ratios = []
    for _ in range(_TURNS):
        seconds = {run: _timed(run, 1) for run in sides}
        ratios.append(seconds[theirs] / seconds[ours])
        sides.reverse()
    return statistics.median(ratios)


def _timed(run: Callable[[int], None], calls: int) -> float:
    # Processor time of all threads: other load on the machine does not count.
    began = time.process_time()
    run(calls)
    return time.process_time() - began


def memory() -> float:
    """Return the memory of this process (MB)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def tell(version: str, imported: float, rates: Rates) -> None:
    """Print the measurements as JSON for the parent; `imported` is the time of the import (s)."""
    print(json.dumps({"version": version, "import": imported, "memory": memory(), "rates": rates}))
