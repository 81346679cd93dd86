"""Vehicles of a batch, in plain Python or compiled: the same flights to the bit."""

from collections.abc import Sequence
from types import ModuleType
from typing import Protocol

import numpy as np
import numpy.typing as npt

from quadctl.schemas.params import DynamicsParams
from quadctl.services.campaign.score import Floats
from quadctl.services.dynamics.compiled.fleet import CompiledFleet
from quadctl.services.dynamics.compiled.kernel import CONSTANTS, WIDTH, span
from quadctl.services.dynamics.flight_modes import Point, periods_of, room
from quadctl.services.dynamics.vehicle import Vehicle

Columns = npt.NDArray[np.intp]
Box = tuple[Point, Point]
"""Lowest and highest corner, m."""


class VehicleBatch(Protocol):
    """Interface of a campaign's vehicles."""

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m."""

    def brake(self, number: int) -> None:
        """Bring one vehicle to rest."""

    def advance(self, steps: int) -> None:
        """Fly all of them, 1 ms a step."""

    def motion(self) -> Floats:
        """Return positions (m) and velocities (m/s): (6, vehicles)."""

    def room(self, number: int) -> Box:
        """Return the box that a vehicle would stay in if it braked now."""


class Plain:
    """Vehicles in plain Python, one by one."""

    def __init__(self, params: Sequence[DynamicsParams]) -> None:
        """Put each at rest on its start."""
        self._vehicles = [_Braking(each) for each in params]

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m."""
        self._vehicles[number].goto(x, y, z)

    def brake(self, number: int) -> None:
        """Bring one vehicle to rest."""
        self._vehicles[number].brake()

    def advance(self, steps: int) -> None:
        """Fly all of them, 1 ms a step."""
        for vehicle in self._vehicles:
            vehicle.advance(steps)

    def motion(self) -> Floats:
        """Return positions (m) and velocities (m/s): (6, vehicles)."""
        return np.array([vehicle.state[:6] for vehicle in self._vehicles]).T

    def room(self, number: int) -> Box:
        """Return the box that a vehicle would stay in if it braked now."""
        return self._vehicles[number].room()


class Compiled(CompiledFleet):
    """Vehicles compiled by numba."""

    def __init__(self, params: Sequence[DynamicsParams], kernel: ModuleType) -> None:
        """Put each at rest on its start; `kernel` is the module from dynamics' kernel.py."""
        super().__init__(params, kernel)
        blocks, lanes = self._places.T
        columns = blocks * WIDTH + lanes
        # Vehicles of one kind, nearly always all of them, are in order.
        in_order = np.array_equal(columns, np.arange(len(params)))
        self._columns: slice | Columns = slice(len(params)) if in_order else columns
        limits = self.constants[blocks, span(CONSTANTS, "limits")]
        self._periods = [periods_of(tuple(row)) for row in limits.tolist()]

    def motion(self) -> Floats:
        """Return positions (m) and velocities (m/s): (6, vehicles)."""
        # Copied: with a single block this would be a view, which shows later motions.
        return self._rows[:, :6].transpose(1, 0, 2).reshape(6, -1)[:, self._columns].copy()

    def room(self, number: int) -> Box:
        """Return the box that a vehicle would stay in if it braked now."""
        found: Box = self._kernel.room(
            self.blocks, self.constants, *self._homes[number], self._periods[number]
        )
        return found


class _Braking(Vehicle):
    def room(self) -> Box:
        limits = self._constants[3]
        return room(self._plan, self._mode, limits, periods_of(limits))
