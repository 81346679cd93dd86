"""Many vehicles on numpy arrays: every number of the model is an array of one for each."""

import ast
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from schemas.params import DynamicsParams
from services.dynamics import pilot
from services.dynamics.controller import STEPS
from services.dynamics.fleet.lanes import Value, branch, one, put, select, stack
from services.dynamics.fleet.text import merged
from services.dynamics.fleet.vectorise import Vectorise
from services.dynamics.pilot import Mode
from services.dynamics.setpoint import Plan
from services.dynamics.vehicle import constants_of, initial

CHUNK = 1024
"""Vehicles that are stepped together: their arrays fit the processor's caches."""


def on_arrays(*names: str) -> list[Callable[..., Any]]:
    """Functions of the model's text (`pilot_move` is `pilot.move`), a vehicle to each element."""
    functions = [Vectorise().visit(function) for function in merged(names)]
    tree = ast.fix_missing_locations(ast.Module(functions, []))
    found: dict[str, Any] = {"sqrt": np.sqrt, "select": select, "branch": branch}
    exec(compile(tree, "<the model on arrays>", "exec"), found)  # noqa: S102 - our own text
    return [found[name] for name in names]


_control_period, _move = on_arrays("pilot_control_period", "pilot_move")


class ArrayFleet:
    """Vehicles that each do, to the bit, what a `Vehicle` with these parameters does."""

    def __init__(self, params: Sequence[DynamicsParams]) -> None:
        """Each at rest on its start, at time 0."""
        self.steps = 0
        """Integration steps since boot."""
        self._chunks = [_Chunk(params[i : i + CHUNK]) for i in range(0, len(params), CHUNK)]

    def goto(self, number: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m, world."""
        chunk, lane = divmod(number, CHUNK)
        self._chunks[chunk].goto(lane, x, y, z)

    def brake(self, number: int) -> None:
        """Let one vehicle come to rest."""
        chunk, lane = divmod(number, CHUNK)
        self._chunks[chunk].brake(lane)

    def advance(self, steps: int) -> None:
        """Run this many integration steps of 1 ms; every fourth since boot is a control step."""
        for chunk in self._chunks:
            chunk.advance(self.steps, steps)
        self.steps += steps

    def states(self) -> npt.NDArray[np.float64]:
        """The states, (vehicles, 17), in the order of rigidbody.py."""
        return np.concatenate([chunk.states() for chunk in self._chunks])


class _Chunk:
    def __init__(self, params: Sequence[DynamicsParams]) -> None:
        self._count = len(params)
        self._constants = stack([constants_of(each) for each in params])
        self._lanes: Value = stack([initial(each) for each in params])

    def goto(self, lane: int, x: float, y: float, z: float) -> None:
        _, _, _, limits, _, spin_up, _ = one(self._constants, lane)
        _, _, plan, mode, _ = one(self._lanes, lane)
        self._tell(lane, pilot.goto(plan, mode, x, y, z, spin_up, limits))

    def brake(self, lane: int) -> None:
        _, _, plan, mode, _ = one(self._lanes, lane)
        self._tell(lane, pilot.brake(plan, mode, one(self._constants, lane)[3]))

    def _tell(self, lane: int, new: tuple[Plan, Mode]) -> None:
        state, command, plan, mode, air = self._lanes
        plan, mode = put((plan, mode), np.array([lane]), new, self._count)
        self._lanes = state, command, plan, mode, air

    def advance(self, start: int, steps: int) -> None:
        state, command, plan, mode, air = self._lanes
        constants = self._constants
        # Of a selection both sides are computed, also the one that is not defined.
        with np.errstate(divide="ignore", invalid="ignore"):
            for count in range(start, start + steps):
                if count % STEPS == 0:
                    command, plan, mode, air = _control_period(
                        state, command, plan, mode, air, constants
                    )
                state = _move(state, command, mode, air[0:3], constants[0])
        self._lanes = state, command, plan, mode, air

    def states(self) -> npt.NDArray[np.float64]:
        rows = np.empty((17, self._count))
        for row, value in zip(rows, self._lanes[0], strict=True):
            row[...] = value
        return rows.T
