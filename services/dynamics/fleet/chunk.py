"""Vehicles that are stepped together on arrays: a row for each of the model's numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
import numpy.typing as npt

from schemas.params import DynamicsParams
from services.dynamics import pilot
from services.dynamics.controller import STEPS
from services.dynamics.fleet.lanes import branch, select
from services.dynamics.fleet.scratch import Scratch
from services.dynamics.fleet.storage import aligned
from services.dynamics.fleet.straight.emit import Program
from services.dynamics.fleet.straight.operations import Register
from services.dynamics.fleet.straight.program import program
from services.dynamics.fleet.straight.symbols import traced
from services.dynamics.fleet.trees import Tree, flat, mapped
from services.dynamics.fleet.vectorise import on_arrays
from services.dynamics.pilot import PERIODS_TO_REST
from services.dynamics.vehicle import constants_of, initial

_numbers = count()
_LANE = mapped(lambda _: Register("row", next(_numbers)), initial(DynamicsParams()))
"""The rows of all that a vehicle is."""
_STATE, _COMMAND, _PLAN, _MODE, _AIR = _LANE
_CALM = _MODE[2].number
_TOLD = [register.number for register in flat((_PLAN, _MODE))]
_WAITS = Register("row", next(_numbers))
"""1 where a control period was not all of it, else 0."""
_OWN = next(_numbers)
"""The first row of what the vehicles' parameters differ in."""

_remainder = on_arrays("everyday_remainder", sqrt=np.sqrt, select=select, branch=branch)


class Chunk:
    """Some vehicles, of whatever parameters; what they have in common takes no rows."""

    def __init__(self, params: Sequence[DynamicsParams], made: dict[str, "Programs"]) -> None:
        """Each at rest on its start; programs that are `made` are used again."""
        lanes = [initial(each) for each in params]
        own: list[Sequence[float]] = []

        def shared(*numbers: float) -> Register | float:
            if len(set(numbers)) == 1:
                return numbers[0]
            own.append(numbers)
            return Register("row", _OWN + len(own) - 1)

        self._constants = mapped(shared, *(constants_of(each) for each in params))
        still = self._constants[6][4] == 0.0
        air = mapped(shared, *(air[0:3] for _, _, _, _, air in lanes)) if still else _AIR[0:3]
        self._rows = aligned(_OWN + len(own), len(params))
        self._rows[: _WAITS.number] = np.array([flat(lane) for lane in lanes]).T
        self._rows[_WAITS.number] = 0.0
        for row, numbers in enumerate(own, _OWN):
            self._rows[row] = numbers
        # By its text 0.0 is told from -0.0.
        key = repr((self._constants, air))
        if key not in made:
            made[key] = Programs.of(self._constants, air)
        self._programs = made[key]

    def goto(self, lane: int, x: float, y: float, z: float) -> None:
        """Send one vehicle to a point, m, world."""
        plan, mode, limits, spin_up = self._numbers(lane)
        self._tell(lane, pilot.goto(plan, mode, x, y, z, spin_up, limits))

    def brake(self, lane: int) -> None:
        """Let one vehicle come to rest."""
        plan, mode, limits, _ = self._numbers(lane)
        self._tell(lane, pilot.brake(plan, mode, limits))

    def _numbers(self, lane: int) -> Any:
        constants = self._constants
        return _read(self._rows[:, lane].tolist(), (_PLAN, _MODE, constants[3], constants[5]))

    def _tell(self, lane: int, told: Tree) -> None:
        self._rows[_TOLD, lane] = flat(told)

    def advance(self, start: int, steps: int, scratch: Scratch) -> None:
        """Run so many steps of 1 ms, `start` of them after boot; every fourth is a control step."""
        at, end = start, start + steps
        while at < end:
            if at % STEPS == 0:
                self._awake(scratch, self._programs.period, 1)
                self._finish()
            pause = min(end, at - at % STEPS + STEPS)
            self._awake(scratch, self._programs.step, pause - at)
            at = pause

    def _awake(self, scratch: Scratch, program: Program, times: int) -> None:
        """Run a program on those vehicles that are not at rest."""
        awake = np.flatnonzero(self._rows[_CALM] < PERIODS_TO_REST)
        if awake.size == self._rows.shape[1]:
            scratch.run(program, self._rows, times)
        elif awake.size:
            picked = np.take(self._rows, awake, axis=1)
            scratch.run(program, picked, times)
            self._rows[:, awake] = picked

    def _finish(self) -> None:
        """Do what a control period left."""
        lanes = np.flatnonzero(self._rows[_WAITS.number])
        if lanes.size:
            given = _STATE, _COMMAND, _PLAN, _MODE, self._constants[3]
            told = _remainder(*_read(np.take(self._rows, lanes, axis=1), given))
            for row, numbers in zip(_TOLD, flat(told), strict=True):
                self._rows[row, lanes] = numbers
            self._rows[_WAITS.number] = 0.0

    def states(self) -> npt.NDArray[np.float64]:
        """The states, (vehicles, 17), in the order of rigidbody.py."""
        return self._rows[: len(_STATE)].T


def _read(rows: Any, tree: Tree) -> Tree:
    """A tree with its registers' rows."""
    return mapped(lambda leaf: rows[leaf.number] if isinstance(leaf, Register) else leaf, tree)


@dataclass(frozen=True)
class Programs:
    """A vehicle's two: a control period, but for what is rare, and a step."""

    period: Program
    step: Program

    @classmethod
    def of(cls, constants: Tree, air: Tree) -> "Programs":
        """For these constants, and air that moves so, each a float or a row."""
        return cls(
            program(
                traced("everyday_period"),
                (_STATE, _PLAN, _MODE, _AIR, constants),
                (_COMMAND, _PLAN, _MODE, _AIR, _WAITS),
            ),
            program(traced("rigidbody_step"), (_STATE, _COMMAND, air, constants[0]), _STATE),
        )
