"""Vehicles of a batch, in plain Python or compiled: the same flights to the bit."""

from collections.abc import Sequence
from types import ModuleType
from typing import Any, Protocol

import numpy as np

from quadctl.schemas.params import DynamicsParams
from quadctl.services.campaign import watch
from quadctl.services.campaign.watch import Floats
from quadctl.services.dynamics.compiled.fleet import CompiledFleet
from quadctl.services.dynamics.compiled.kernel import CONSTANTS, MOTION, span
from quadctl.services.dynamics.flight_modes import Point, periods_of, room
from quadctl.services.dynamics.vehicle import Vehicle

Box = tuple[Point, Point]
"""Lowest and highest corner, m."""


class VehicleBatch(Protocol):
    """Interface of a campaign's vehicles."""

    loops: Any
    """The module watch.py, or the same compiled."""

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m."""

    def brake(self, number: int) -> None:
        """Bring one vehicle to rest."""

    def fly(self, steps: int, samples: int) -> Floats:
        """Fly all, some steps of 1 ms for each sample; return m and m/s, (samples, 6, vehicles)."""

    def room(self, number: int) -> Box:
        """Return the box that a vehicle would stay in if it braked now."""


class Plain:
    """Vehicles in plain Python, one by one."""

    loops: Any = watch

    def __init__(self, params: Sequence[DynamicsParams]) -> None:
        """Put each at rest on its start."""
        self._vehicles = [_Braking(each) for each in params]

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m."""
        self._vehicles[number].goto(x, y, z)

    def brake(self, number: int) -> None:
        """Bring one vehicle to rest."""
        self._vehicles[number].brake()

    def fly(self, steps: int, samples: int) -> Floats:
        """Fly all, some steps of 1 ms for each sample; return m and m/s, (samples, 6, vehicles)."""
        motions = np.empty((samples, MOTION, len(self._vehicles)))
        for number, vehicle in enumerate(self._vehicles):
            for sample in range(samples):
                vehicle.advance(steps)
                motions[sample, :, number] = vehicle.state[:MOTION]
        return motions

    def room(self, number: int) -> Box:
        """Return the box that a vehicle would stay in if it braked now."""
        return self._vehicles[number].room()


class Compiled(CompiledFleet):
    """Vehicles compiled by numba."""

    def __init__(self, params: Sequence[DynamicsParams], kernel: ModuleType) -> None:
        """Put each at rest on its start; `kernel` is the module from `load_kernel`."""
        super().__init__(params, kernel)
        self.loops: Any = kernel
        limits = self.constants[self._places[:, 0], span(CONSTANTS, "limits")]
        self._periods = [periods_of(tuple(row)) for row in limits.tolist()]

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
