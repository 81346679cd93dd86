"""Speed of the model in plain Python: `python -P -m quadctl.services.dynamics.pace`.

Prints the seconds that one integration step takes on this machine, in flight. Takes about 30 ms in
addition to the start of Python.
"""

import statistics
import time

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics.vehicle import Vehicle

_BURST = 100
"""Steps timed together."""
_PATIENCE = 0.03
"""Seconds after which no new burst begins."""
_FAR = 1000.0
"""Metres to the goal: too far to reach during the bursts."""


def step_seconds() -> float:
    """Return the median time of a step over several bursts of a take-off and a flight."""
    vehicle = Vehicle(DynamicsParams())
    vehicle.goto(_FAR, _FAR, _FAR)
    vehicle.advance(_BURST)
    times: list[float] = []
    began = before = time.perf_counter()
    while before < began + _PATIENCE:
        vehicle.advance(_BURST)
        now = time.perf_counter()
        times.append((now - before) / _BURST)
        before = now
    return statistics.median(times)


if __name__ == "__main__":
    print(step_seconds())  # noqa: T201 - the answer to the launcher
