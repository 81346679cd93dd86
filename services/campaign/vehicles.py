"""Vehicles of a batch, in plain Python or compiled: the same flights to the bit."""

from collections.abc import Sequence
from types import ModuleType
from typing import Any, Protocol

import numpy as np

from quadctl.schemas.params import DynamicsParams
from quadctl.services.airspace.geometry import Box
from quadctl.services.campaign import watch
from quadctl.services.campaign.watch import Floats
from quadctl.services.dynamics.compiled.aot import lane_of
from quadctl.services.dynamics.compiled.fleet import CompiledFleet, flat
from quadctl.services.dynamics.compiled.kernel import MOTION
from quadctl.services.dynamics.flight_modes import room
from quadctl.services.dynamics.vehicle import Vehicle

"""Lowest and highest corner, m."""


class VehicleBatch(Protocol):
    """Interface of a campaign's vehicles."""

    loops: Any
    """The module watch.py, or the same compiled."""

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m."""

    def brake(self, number: int) -> None:
        """Bring one vehicle to rest."""

    def configure(self, number: int, params: DynamicsParams) -> None:
        """Give one vehicle new parameters; body, gains and limits count from its next standstill."""

    def in_force(self, number: int) -> DynamicsParams:
        """Return the parameters that one vehicle flies by."""

    def fly(self, steps: int, samples: int) -> Floats:
        """Fly all, some steps of 1 ms for each sample; return m and m/s, (samples, 6, vehicles)."""

    def room(self, number: int) -> Box:
        """Return the box that a vehicle would stay in if it braked now."""


class Plain:
    """Vehicles in plain Python, one by one."""

    loops: Any = watch

    def __init__(self, params: Sequence[DynamicsParams]) -> None:
        """Put each at rest on its start."""
        self._vehicles = [_Lane(each) for each in params]

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m."""
        self._vehicles[number].goto(x, y, z)

    def brake(self, number: int) -> None:
        """Bring one vehicle to rest."""
        self._vehicles[number].brake()

    def configure(self, number: int, params: DynamicsParams) -> None:
        """Give one vehicle new parameters; body, gains and limits count from its next standstill."""
        self._vehicles[number].configure(params)

    def in_force(self, number: int) -> DynamicsParams:
        """Return the parameters that one vehicle flies by."""
        return self._vehicles[number].in_force

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
        self._params = params
        self._configured: dict[int, _Lane] = {}
        self._waiting: set[int] = set()
        """Vehicles with parameters that wait for a standstill."""

    def configure(self, number: int, params: DynamicsParams) -> None:
        """Give one vehicle new parameters; body, gains and limits count from its next standstill."""
        if number not in self._configured:
            self._configured[number] = _Lane(self._params[number])
        self._configured[number].load(self.numbers(number))
        self._configured[number].configure(params)
        self._store(number)

    def in_force(self, number: int) -> DynamicsParams:
        """Return the parameters that one vehicle flies by."""
        vehicle = self._configured.get(number)
        return vehicle.in_force if vehicle else self._params[number]

    def fly(self, steps: int, samples: int = 1) -> Floats:
        """Fly all, some steps of 1 ms for each sample; return m and m/s, (samples, 6, vehicles)."""
        if not self._waiting:
            return super().fly(steps, samples)
        motions = []
        for _ in range(samples):
            motions.append(super().fly(steps))
            for number in tuple(self._waiting):
                # Vehicle.advance does the same after its steps.
                self._configured[number].load(self.numbers(number))
                if self._configured[number].settles():
                    self._store(number)
        return np.concatenate(motions)

    def _store(self, number: int) -> None:
        vehicle = self._configured[number]
        self.put(number, *vehicle.flat())
        (self._waiting.add if vehicle.waits else self._waiting.discard)(number)

    def room(self, number: int) -> Box:
        """Return the box that a vehicle would stay in if it braked now."""
        found: Box = self._kernel.room(self.blocks, self.constants, *self._homes[number])
        return found


class _Lane(Vehicle):
    """Vehicle of a batch: alone in plain Python, or the parameters of one that flies compiled."""

    @property
    def waits(self) -> bool:
        """Return whether parameters wait for a standstill."""
        return self._wanted is not None

    def room(self) -> Box:
        """Return the box that it would stay in if it braked now."""
        return room(self._plan, self._mode, self.constants[3])

    def load(self, numbers: Sequence[float]) -> None:
        """Take a compiled vehicle's changing numbers."""
        self._state, self._command, self._plan, self._mode, self._air = lane_of(numbers)

    def settles(self) -> bool:
        """Adopt waiting parameters at a standstill; return whether none wait any more."""
        self._settle()
        return not self.waits

    def flat(self) -> tuple[list[float], tuple[float, ...]]:
        """Return its changing numbers, and its constants, in the order of the kernel."""
        return flat(self.lane), tuple(flat(self.constants))
