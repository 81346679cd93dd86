"""Limit on the vehicles that this machine flies in plain Python; checked before a launch of several.

The extra `fleet` brings numba, which flies them compiled: then nothing is timed or refused.
"""

import importlib.util
import subprocess
import sys
from collections.abc import Sequence

from quadctl.services.runtime.errors import QuadctlError, UsageError
from quadctl.services.runtime.supervisor.launch import Launch

_PACE = (sys.executable, "-P", "-m", "quadctl.services.dynamics.pace")
_TIMEOUT = 20.0
_STEPS_PER_SECOND = 1000
_SETPOINTS = 200.0
"""What the setpoints of one vehicle cost in a second, in integration steps."""
_POSE = 4.0
"""What one pose costs beside its steps, in integration steps."""
_SHARE = 0.7
"""Part of a core that the vehicles may take; the rest is for bursts and for others."""


def most(step: float, rates: Sequence[float]) -> int:
    """Return how many vehicles with such rates (Hz) one core flies, if one step takes `step` s."""
    steps = sum(_STEPS_PER_SECOND + _SETPOINTS + _POSE * rate for rate in rates)
    return int(len(rates) * _SHARE / (step * steps))


def check(launch: Launch) -> None:
    """Raise UsageError for more vehicles than plain Python can fly, if there is no numba.

    At speeds other than 1 the simulated clock waits for the vehicles, however many they are.
    """
    rates = [params.dynamics.rate for params in launch.fleet.values()]
    if len(rates) == 1 or "dynamics" in launch.without or launch.params.dynamics.speed != 1:
        return
    if importlib.util.find_spec("numba") is not None:
        return
    found = most(_step_seconds(), rates)
    if len(rates) > found:
        low, high = min(rates), max(rates)
        hz = f"{low:g}" if low == high else f"{low:g} to {high:g}"
        raise UsageError(
            f"this machine flies about {found} vehicles at {hz} Hz in plain Python,"
            f" {len(rates)} were asked for",
            "pip install 'quadctl[fleet]', in the environment of quadctl, flies them compiled;"
            " or give fewer --vehicles",
        )


def _step_seconds() -> float:
    """Time a step in a process of its own: the model is a service's, and not loaded here."""
    done = subprocess.run(_PACE, capture_output=True, text=True, check=False, timeout=_TIMEOUT)
    try:
        return float(done.stdout)
    except ValueError as error:
        raise QuadctlError(
            f"the vehicle's step could not be timed before the launch: {done.stderr.strip()}",
            "`quadctl doctor` checks the installation",
        ) from error
