"""Flight quality, measured on the pose topic of the real system."""

import json
import math
import subprocess
import time

from benchmarks.effort import Effort
from benchmarks.results import Results
from benchmarks.system import QUADCTL, Home, running

_STEP = 3.0
_SECONDS = 6.0
_HZ = 100


def measure(results: Results, effort: Effort) -> None:
    """Measure steps of 3 m along x, there and back, and the hover after each."""
    with running() as where:
        where.quadctl("goto", "0", "0", "1")
        time.sleep(_SECONDS / 2)
        for number in range(effort.flights):
            goal = _STEP * ((number + 1) % 2)
            poses = fly(where, goal)
            left = [(stamp, abs(goal - x)) for stamp, x, _ in poses]
            side = 1 if goal else -1
            errors = [(x - goal) ** 2 + y * y for _, x, y in poses[-2 * _HZ :]]
            results.add("within_05", "ours", [first_within(left, 0.5)])
            results.add("within_02", "ours", [first_within(left, 0.2)])
            results.add("overshoot", "ours", [max(0.0, *(side * (x - goal) for _, x, _ in poses))])
            results.add("hover", "ours", [math.sqrt(sum(errors) / len(errors))])


def fly(where: Home, goal: float) -> list[tuple[float, float, float]]:
    """Fly one step; return its poses (simulated s since the start, x, y)."""
    count = str(int(_SECONDS * _HZ))
    words = [QUADCTL, "topic", "echo", "pose", "-n", count, "--json"]
    with subprocess.Popen(words, env=where.environment, stdout=subprocess.PIPE, text=True) as echo:
        assert echo.stdout is not None
        echo.stdout.readline()
        where.quadctl("goto", "--no-wait", f"{goal:g}", "0", "1")
        poses = [json.loads(line) for line in echo.stdout]
    # The instant of the request is not on the topic, so the flight begins with the first motion.
    began = next(p["stamp"] for p in poses if abs(p["velocity"]["x"]) > 1e-6)
    return [(p["stamp"] - began, p["position"]["x"], p["position"]["y"]) for p in poses]


def first_within(left: list[tuple[float, float]], reach: float) -> float:
    """Return the last time (s) at which the distance (m) was beyond `reach`."""
    return max(stamp for stamp, distance in left if distance > reach)
