"""How well the vehicle flies, as the pose topic of the real system tells it."""

import json
import math
import subprocess
import time
from collections.abc import Iterator
from typing import Any

from benchmarks.figure import Figure, figure
from benchmarks.system import QUADCTL, home, quadctl

_STEP = 3.0
_SECONDS = 6.0
_HZ = 100
_FLIGHTS = 5


def measure() -> Iterator[Figure]:
    """Steps of 3 m along x, there and back, and the hover after each."""
    near, nearer, over, hover = [], [], [], []
    with home() as environment:
        quadctl(environment, "up", "-d")
        try:
            quadctl(environment, "goto", "0", "0", "1")
            time.sleep(_SECONDS / 2)
            for number in range(_FLIGHTS):
                goal = _STEP * ((number + 1) % 2)
                poses = fly(environment, goal)
                left = [(stamp, abs(goal - x), x) for stamp, x, _ in poses]
                near.append(first_within(left, 0.5))
                nearer.append(first_within(left, 0.2))
                side = 1 if goal else -1
                over.append(max(0.0, *(side * (x - goal) for _, _, x in left)))
                tail = poses[-2 * _HZ :]
                errors = [(x - goal) ** 2 + y * y for _, x, y in tail]
                hover.append(math.sqrt(sum(errors) / len(errors)))
        finally:
            quadctl(environment, "down")
    yield figure("3 m step: within 0.5 m", "s", 1.6, near)
    yield figure("3 m step: within 0.2 m", "s", 1.9, nearer)
    yield figure("3 m step: overshoot", "m", 0.01, over)
    yield figure("hover error, RMS", "m", 0.005, hover)


def fly(environment: dict[str, str], goal: float) -> list[tuple[float, float, float]]:
    """Poses (simulated s since the request, x, y) of one step."""
    count = str(int(_SECONDS * _HZ))
    words = [*QUADCTL, "topic", "echo", "pose", "-n", count, "--json"]
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True) as echo:
        assert echo.stdout is not None
        first: Any = json.loads(echo.stdout.readline())
        del first
        reply = subprocess.Popen(
            [*QUADCTL, "goto", "--no-wait", f"{goal:g}", "0", "1"],
            env=environment,
            stdout=subprocess.DEVNULL,
        )
        poses = [json.loads(line) for line in echo.stdout]
        reply.wait()
    # The request's own instant is not on the topic: the flight begins with the first motion.
    began = next(p["stamp"] for p in poses if abs(p["velocity"]["x"]) > 1e-6)
    return [(p["stamp"] - began, p["position"]["x"], p["position"]["y"]) for p in poses]


def first_within(left: list[tuple[float, float, float]], reach: float) -> float:
    """The first time from which the distance stays within reach."""
    outside = [stamp for stamp, distance, _ in left if distance > reach]
    return max(outside)
