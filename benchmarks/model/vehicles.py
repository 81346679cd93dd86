"""Vehicles of the benchmark: high up, and in flight if there is a setpoint."""

from collections.abc import Callable

from quadctl.schemas.params import DynamicsParams, StartParams

FAR = 1e5
"""Distance (m) of a goal that no flight here reaches."""
STEPS = 100
"""Steps per call of compiled code."""


def flying() -> DynamicsParams:
    return DynamicsParams(start=StartParams(0.0, 0.0, 1000.0))


def send(goto: Callable[[int, float, float, float], None], count: int) -> None:
    """Send each vehicle to a different goal, by the command of its fleet."""
    for number in range(count):
        goto(number, FAR, FAR - number, 1000.0)
