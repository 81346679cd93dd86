"""CompiledFleet: thousands of vehicles in compiled code."""

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics.compiled.kernel import MOTION, ROWS, STORED, WIDTH
from quadctl.services.dynamics.vehicle import constants_of, initial

LINE = 8
"""Numbers in a cache line, and in the longest vector."""


def aligned(rows: int, columns: int) -> npt.NDArray[np.float64]:
    """Return an array with each row at the start of a cache line, for unsplit vectors."""
    width = -(-columns // LINE) * LINE
    room = np.empty(rows * width + LINE)
    first = -room.ctypes.data // room.itemsize % LINE
    return room[first : first + rows * width].reshape(rows, width)[:, :columns]


Tree = Any
"""A leaf, or a tuple of trees."""


def flat(tree: Tree) -> list[Any]:
    """Return the leaves, in order."""
    if isinstance(tree, tuple):
        return [leaf for part in tree for leaf in flat(part)]
    return [tree]


class CompiledFleet:
    """Vehicles that are bit-identical to a `Vehicle` with the same parameters."""

    def __init__(self, params: Sequence[DynamicsParams], kernel: ModuleType) -> None:
        """Put each at rest on its start, at time 0; `kernel` is the module from kernel.py."""
        self.steps = 0
        """Integration steps since boot."""
        self._kernel = kernel
        kinds: dict[tuple[float, ...], list[int]] = {}
        for number, each in enumerate(params):
            kinds.setdefault(tuple(flat(constants_of(each))), []).append(number)
        self._places = np.empty((len(params), 2), dtype=np.intp)
        """Block and lane of each vehicle; vehicles in a block share their constants."""
        rows: list[tuple[float, ...]] = []
        for constants, numbers in kinds.items():
            for place, number in enumerate(numbers):
                block, lane = divmod(place, WIDTH)
                self._places[number] = len(rows) + block, lane
            rows += [constants] * -(-len(numbers) // WIDTH)
        columns = self._places[:, 0] * WIDTH + self._places[:, 1]
        # Vehicles of one kind, nearly always all of them, are in order.
        in_order = np.array_equal(columns, np.arange(len(params)))
        self._columns = slice(len(params)) if in_order else columns
        self._homes: list[tuple[int, int]] = [(b, n) for b, n in self._places.tolist()]
        """The same as tuples, for commands."""
        self.constants = np.array(rows)
        """A row for each block, see kernel.py."""
        self.blocks = aligned(len(rows), ROWS * WIDTH)
        """The vehicles' numbers, see kernel.py."""
        # A lane without a vehicle holds one at rest on the floor.
        self._still = np.array(flat(initial(DynamicsParams())))
        self._rows[:, :STORED, :] = self._still[None, :, None]
        self._rows[self._places[:, 0], :STORED, self._places[:, 1]] = [
            flat(initial(each)) for each in params
        ]
        self._filled: dict[tuple[float, ...], tuple[int, int]] = {}
        """Newest block for vehicles that came to these constants in flight, and its vehicles."""

    @property
    def _rows(self) -> npt.NDArray[np.float64]:
        return self.blocks.reshape(-1, ROWS, WIDTH)

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m, world."""
        self._kernel.goto(self.blocks, self.constants, *self._homes[number], x, y, z)

    def brake(self, number: int) -> None:
        """Bring one vehicle to rest."""
        self._kernel.brake(self.blocks, self.constants, *self._homes[number])

    def fly(self, steps: int, samples: int = 1) -> npt.NDArray[np.float64]:
        """Fly all, some steps of 1 ms for each sample; every fourth step since boot is a control step.

        Returns positions (m) and velocities (m/s), (samples, 6, vehicles).
        """
        motions = np.empty((samples, MOTION, self.blocks.shape[0] * WIDTH))
        self._kernel.fly(self.blocks, self.constants, self.steps, steps, motions)
        self.steps += steps * samples
        # Contiguous: what reads them is compiled for one layout.
        return np.ascontiguousarray(motions[:, :, self._columns])

    def numbers(self, number: int) -> tuple[float, ...]:
        """Return the changing numbers of one vehicle, in the order of a block's rows."""
        block, lane = self._homes[number]
        return tuple(self._rows[block, :STORED, lane].tolist())

    def put(self, number: int, numbers: Sequence[float], constants: tuple[float, ...]) -> None:
        """Change the numbers of one vehicle; with other constants it moves to another block."""
        block, lane = self._homes[number]
        if constants != tuple(self.constants[block]):
            self._rows[block, :STORED, lane] = self._still
            block, lane = self._filled.get(constants, (0, WIDTH))
            if lane == WIDTH:
                block, lane = self._added(constants), 0
            self._filled[constants] = block, lane + 1
            self._homes[number] = block, lane
            self._places[number] = block, lane
            self._columns = self._places[:, 0] * WIDTH + self._places[:, 1]
        self._rows[block, :STORED, lane] = numbers

    def _added(self, constants: tuple[float, ...]) -> int:
        """Add a block with these constants; return its number."""
        before = self.blocks
        self.blocks = aligned(len(before) + 1, ROWS * WIDTH)
        self.blocks[:-1] = before
        self._rows[-1, :STORED] = self._still[:, None]
        self.constants = np.vstack((self.constants, constants))
        return len(before)

    def states(self) -> npt.NDArray[np.float64]:
        """Return the states, (vehicles, 17), in the order of rigidbody.py."""
        return self._rows[self._places[:, 0], :17, self._places[:, 1]]
