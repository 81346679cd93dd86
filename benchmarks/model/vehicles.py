"""The vehicles that the benchmark flies: high up, and on their way where there is a setpoint."""

from collections.abc import Callable

from quadctl.schemas.params import DynamicsParams, StartParams

FAR = 1e5
"""A goal that no flight here reaches, m."""
STEPS = 100
"""Steps in a call of what is compiled."""


def flying() -> DynamicsParams:
    return DynamicsParams(start=StartParams(0.0, 0.0, 1000.0))


def send(goto: Callable[[int, float, float, float], None], count: int) -> None:
    """Each to a goal of its own, by its fleet's command."""
    for number in range(count):
        goto(number, FAR, FAR - number, 1000.0)
