"""How fast something goes, in any environment. Standard library only."""

import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

COUNTS = (1, 10, 100, 1000, 10_000, 100_000)
"""Vehicles at once."""
_ROUNDS = 4
_SECONDS = 0.2
"""What one round takes, about; the best of the rounds counts, what else ran only slows them."""

_TURNS = 41
"""Slices of each side where two are compared in turn."""

Rates = dict[str, dict[int, float]]
"""Vehicle-steps per second of processor, by what was run and the number of vehicles."""


def rate(run: Callable[[int], None], vehicle_steps: float) -> float:
    """Vehicle-steps per second of processor of `run(calls)`, where each call makes that many."""
    run(1)  # compiled, loaded, allocated
    calls, seconds = 1, 0.0
    while seconds < _SECONDS:
        seconds = _timed(run, calls)
        if seconds < _SECONDS:
            calls = max(2 * calls, int(calls * _SECONDS / max(seconds, 1e-6)))
    best = min([seconds, *(_timed(run, calls) for _ in range(_ROUNDS))])
    return vehicle_steps * calls / best


def in_turn(ours: Callable[[int], None], theirs: Callable[[int], None]) -> float:
    """How many times as fast ours is, both of one call that does as much: the median of many ratios.

    The two sides of each ratio ran at once after one another, the first in turn: the processor's
    speed, which wanders by itself, is the same for both.
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
    # Processor time, of all threads: what else runs on the machine takes none of it.
    began = time.process_time()
    run(calls)
    return time.process_time() - began


def memory() -> float:
    """What the process has in memory, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def tell(version: str, imported: float, rates: Rates) -> None:
    """Print what was measured, for the one who asked; `imported` is the import's time, s."""
    print(json.dumps({"version": version, "import": imported, "memory": memory(), "rates": rates}))
