"""The vehicles of a batch: in plain Python, on arrays, or compiled; the same flights to the bit."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from schemas.params import DynamicsParams
from services.dynamics import pilot, setpoint
from services.dynamics.controller import PERIOD
from services.dynamics.fleet.compiled import CompiledFleet, Kernel
from services.dynamics.pilot import Mode
from services.dynamics.setpoint import Plan
from services.dynamics.sharing import Limits
from services.dynamics.vehicle import Vehicle

Point = tuple[float, float, float]
Floats = npt.NDArray[np.float64]

_LAGS = 6.0
"""Lags of the setpoint after which it is on its path's last stretch."""
_EVERY = 4
"""Control periods between the points of a stop."""


class Fleet(Protocol):
    """What a campaign wants of its vehicles."""

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m."""

    def brake(self, number: int) -> None:
        """Let one vehicle come to rest."""

    def advance(self, steps: int) -> None:
        """Fly all of them, 1 ms a step."""

    def motion(self) -> Floats:
        """Positions (m) and velocities (m/s): (6, vehicles)."""

    def stop(self, number: int) -> Sequence[Point]:
        """Where a vehicle would come along that was to brake now, m: the first point and on."""


class Plain:
    """Vehicles in plain Python, one by one."""

    def __init__(self, params: Sequence[DynamicsParams]) -> None:
        """Each at rest on its start."""
        self._vehicles = [_Braking(each) for each in params]

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m."""
        self._vehicles[number].goto(x, y, z)

    def brake(self, number: int) -> None:
        """Let one vehicle come to rest."""
        self._vehicles[number].brake()

    def advance(self, steps: int) -> None:
        """Fly all of them, 1 ms a step."""
        for vehicle in self._vehicles:
            vehicle.advance(steps)

    def motion(self) -> Floats:
        """Positions (m) and velocities (m/s): (6, vehicles)."""
        return np.array([vehicle.state[:6] for vehicle in self._vehicles]).T

    def stop(self, number: int) -> Sequence[Point]:
        """Where a vehicle would come along that was to brake now, m."""
        return self._vehicles[number].stop()


class Compiled(CompiledFleet):
    """Vehicles compiled by numba."""

    def __init__(self, params: Sequence[DynamicsParams], advance: Kernel) -> None:
        """Each at rest on its start; `advance` is the compiled kernel's."""
        super().__init__(params, advance)
        self._blocks_of, self._lanes_of = self._places.T.copy()

    def motion(self) -> Floats:
        """Positions (m) and velocities (m/s): (6, vehicles)."""
        return self._rows[self._blocks_of, :6, self._lanes_of].T

    def stop(self, number: int) -> Sequence[Point]:
        """Where a vehicle would come along that was to brake now, m."""
        plan, mode, limits, _ = self._told(number)
        return _stop(plan, mode, limits)


class _Braking(Vehicle):
    def stop(self) -> Sequence[Point]:
        return _stop(self._plan, self._mode, self._constants[3])


def _stop(plan: Plan, mode: Mode, limits: Limits) -> Sequence[Point]:
    """The setpoint's way to its stopping point; it lags behind its own path, which may have turned."""
    points = [pilot.place(plan, limits)]
    if setpoint.at_rest(plan, limits):
        return points
    plan, _ = pilot.brake(plan, mode, limits)
    for count in range(round(_LAGS * limits[3] / PERIOD)):
        plan = setpoint.advance(plan, limits)
        if count % _EVERY == 0:
            points.append(pilot.place(plan, limits))
    return [*points, (plan[0][3], plan[1][3], plan[2][3])]
