"""Speed of the model in plain Python: `python -P -m quadctl.services.dynamics.pace`.

Prints the seconds of a processor that one integration step takes on this machine, in flight. Takes about
0.1 s in addition to the start of Python.
"""

import time

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics.vehicle import Vehicle

_BURST = 100
"""Steps between two looks at the time."""
_PATIENCE = 0.1
"""Seconds of a processor to fly for; Windows counts them in units of 16 ms."""
_FAR = 1000.0
"""Metres to the goal: too far to reach during the bursts."""


def step_seconds() -> float:
    """Return the mean time of a step in a take-off and a flight, however busy the machine is."""
    vehicle = Vehicle(DynamicsParams())
    vehicle.goto(_FAR, _FAR, _FAR)
    vehicle.advance(_BURST)
    steps, began = 0, time.process_time()
    while (passed := time.process_time() - began) < _PATIENCE:
        vehicle.advance(_BURST)
        steps += _BURST
    return passed / steps


if __name__ == "__main__":
    print(step_seconds())  # noqa: T201 - the answer to the launcher
