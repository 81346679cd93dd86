"""Limit on the vehicles that this machine flies in plain Python, checked before a launch.

With numba, from the extra `fleet`, they fly compiled: then nothing is timed or refused.
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
"""Cost of one vehicle's setpoints per second, in integration steps."""
_POSE = 4.0
"""Cost of publishing one pose, in integration steps."""
_SHARE = 0.7
"""Part of a core that the vehicles may use; the rest is for bursts and other processes."""


def most(step: float, rates: Sequence[float]) -> int:
    """Return the number of vehicles with such rates (Hz) per core, if one step takes `step` s."""
    steps = sum(_STEPS_PER_SECOND + _SETPOINTS + _POSE * rate for rate in rates)
    return int(len(rates) * _SHARE / (step * steps))


def check(launch: Launch) -> None:
    """Raise UsageError for more vehicles than plain Python can fly, if numba is not installed.

    In lock-step the simulated clock waits for any number of vehicles.
    """
    rates = [params.dynamics.rate for params in launch.fleet.values()]
    if len(rates) == 1 or "dynamics" in launch.without or launch.params.dynamics.in_lockstep:
        return
    if importlib.util.find_spec("numba") is not None:
        return
    found = most(_step_seconds(), rates)
    if len(rates) > found:
        hz = " to ".join(f"{rate:g}" for rate in sorted({min(rates), max(rates)}))
        raise UsageError(
            f"this machine flies about {found} vehicles at {hz} Hz in plain Python,"
            f" {len(rates)} were asked for",
            "`pip install 'quadctl[fleet]'`, into the same environment, flies them"
            " compiled; or give fewer --vehicles",
        )


def _step_seconds() -> float:
    """Time a step in another process, because the model is not loaded here."""
    done = subprocess.run(_PACE, capture_output=True, text=True, check=False, timeout=_TIMEOUT)
    try:
        return float(done.stdout)
    except ValueError as error:
        raise QuadctlError(
            f"the vehicle's step could not be timed before the launch: {done.stderr.strip()}",
            "`quadctl doctor` checks the installation",
        ) from error
