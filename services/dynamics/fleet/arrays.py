"""Many vehicles on numpy arrays: every number of the model is a row of one for each."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from schemas.params import DynamicsParams
from services.dynamics.fleet.chunk import Chunk, Programs
from services.dynamics.fleet.scratch import Scratch

CHUNK = 4096
"""Vehicles that are stepped together, at most: the more, the less the calls themselves cost, while
what a few calls in a row work on must fit the processor's caches."""


def even(vehicles: int) -> list[int]:
    """The sizes of the chunks of so many vehicles: all the same, but for the last."""
    size = -(-vehicles // -(-vehicles // CHUNK))
    return [min(size, vehicles - first) for first in range(0, vehicles, size)]


class ArrayFleet:
    """Vehicles that each do, to the bit, what a `Vehicle` with these parameters does."""

    def __init__(self, params: Sequence[DynamicsParams]) -> None:
        """Each at rest on its start, at time 0."""
        self.steps = 0
        """Integration steps since boot."""
        sizes = even(len(params))
        self._size = sizes[0]
        made: dict[str, Programs] = {}
        self._chunks = [
            Chunk(params[number * self._size :][:size], made) for number, size in enumerate(sizes)
        ]
        self._scratch = Scratch(
            [each for both in made.values() for each in (both.period, both.step)], self._size
        )

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m, world."""
        chunk, lane = divmod(number, self._size)
        self._chunks[chunk].goto(lane, x, y, z)

    def brake(self, number: int) -> None:
        """Let one vehicle come to rest."""
        chunk, lane = divmod(number, self._size)
        self._chunks[chunk].brake(lane)

    def advance(self, steps: int) -> None:
        """Run this many integration steps of 1 ms; every fourth since boot is a control step."""
        # Of a selection both sides are computed, also the one that is not defined.
        with np.errstate(divide="ignore", invalid="ignore"):
            for chunk in self._chunks:
                chunk.advance(self.steps, steps, self._scratch)
        self.steps += steps

    def states(self) -> npt.NDArray[np.float64]:
        """The states, (vehicles, 17), in the order of rigidbody.py."""
        return np.concatenate([chunk.states() for chunk in self._chunks])
