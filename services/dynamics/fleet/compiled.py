"""Many vehicles, compiled by numba (extra `fleet`): as fast as the processor's arithmetic."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from schemas.params import DynamicsParams
from services.dynamics import pilot
from services.dynamics.fleet.kernel import CONSTANTS, LAYOUT, ROWS, STORED, WIDTH, span
from services.dynamics.pilot import Mode
from services.dynamics.setpoint import Plan
from services.dynamics.vehicle import constants_of, initial

Rows = npt.NDArray[np.float64]
Kernel = Callable[[Rows, Rows, int, int], None]

_TOLD = span(LAYOUT, "plan", "mode")
"""What a command changes."""
_LIMITS, _SPIN_UP = span(CONSTANTS, "limits"), span(CONSTANTS, "spin_up").start


class CompiledFleet:
    """Vehicles that each do, to the bit, what a `Vehicle` with these parameters does."""

    def __init__(self, params: Sequence[DynamicsParams], advance: Kernel) -> None:
        """Each at rest on its start, at time 0; `advance` is the module's that kernel.py writes."""
        self.steps = 0
        """Integration steps since boot."""
        self._advance = advance
        kinds: dict[tuple[float, ...], list[int]] = {}
        for number, each in enumerate(params):
            kinds.setdefault(tuple(_flat(constants_of(each))), []).append(number)
        self._places = np.empty((len(params), 2), dtype=np.intp)
        """Block and lane of each vehicle: those of a block have their constants in common."""
        rows: list[tuple[float, ...]] = []
        for constants, numbers in kinds.items():
            for place, number in enumerate(numbers):
                block, lane = divmod(place, WIDTH)
                self._places[number] = len(rows) + block, lane
            rows += [constants] * -(-len(numbers) // WIDTH)
        self.constants = np.array(rows)
        """A row for each block, see kernel.py."""
        self.blocks = np.empty((len(rows), ROWS * WIDTH))
        """The vehicles' numbers, see kernel.py."""
        # Lanes without a vehicle stand on the floor.
        still = initial(DynamicsParams())
        self._rows[:, :STORED, :] = np.array(_flat(still))[None, :, None]
        self._rows[self._places[:, 0], :STORED, self._places[:, 1]] = [
            _flat(initial(each)) for each in params
        ]

    @property
    def _rows(self) -> npt.NDArray[np.float64]:
        return self.blocks.reshape(-1, ROWS, WIDTH)

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m, world."""
        plan, mode, limits, spin_up = self._told(number)
        self._tell(number, pilot.goto(plan, mode, x, y, z, spin_up, limits))

    def brake(self, number: int) -> None:
        """Let one vehicle come to rest."""
        plan, mode, limits, _ = self._told(number)
        self._tell(number, pilot.brake(plan, mode, limits))

    def advance(self, steps: int) -> None:
        """Run this many integration steps of 1 ms; every fourth since boot is a control step."""
        self._advance(self.blocks, self.constants, self.steps, steps)
        self.steps += steps

    def states(self) -> npt.NDArray[np.float64]:
        """The states, (vehicles, 17), in the order of rigidbody.py."""
        return self._rows[self._places[:, 0], :17, self._places[:, 1]]

    def _told(self, number: int) -> tuple[Plan, Mode, tuple[float, ...], float]:
        block, lane = self._places[number]
        row: list[float] = self._rows[block, _TOLD, lane].tolist()
        x, y, z = (tuple(row[i : i + 9]) for i in (0, 9, 18))
        moving, crowded, periods, still = row[27:31]
        constants: list[float] = self.constants[block].tolist()
        mode: Any = tuple(row[31:])
        plan = (x, y, z, moving, crowded, periods, still)
        return plan, mode, tuple(constants[_LIMITS]), constants[_SPIN_UP]

    def _tell(self, number: int, told: tuple[Plan, Mode]) -> None:
        block, lane = self._places[number]
        self._rows[block, _TOLD, lane] = _flat(told)


def _flat(value: Any) -> list[float]:
    if isinstance(value, tuple):
        return [number for part in value for number in _flat(part)]
    return [value]
