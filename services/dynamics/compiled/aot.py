"""The model in machine code, compiled ahead of time: few vehicles by its unchanged source, many by blocks.

Between two calls a vehicle's numbers are Python's own, so each may change as in `vehicle.py`.
"""

from collections.abc import Sequence
from struct import Struct
from typing import Any, Protocol

from quadctl.services.dynamics.compiled.kernel import (
    CONSTANTS,
    ROWS,
    STORED,
    WIDTH,
    block_source,
)
from quadctl.services.dynamics.flight_modes import PERIODS_TO_REST, Constants, FlightMode
from quadctl.services.dynamics.rigidbody import Motors, State
from quadctl.services.dynamics.trajectory import Plan
from quadctl.services.dynamics.vehicle import Lane
from quadctl.services.dynamics.wind import Air

_NUMBERS = Struct(f"{STORED}d")
"""The changing numbers of a vehicle: state, command, plan, mode and air."""
_FIXED = Struct(f"{sum(CONSTANTS.values())}d")
"""Its constants, in the order of CONSTANTS."""
LINE = 64
"""Bytes of a cache line, at which a block begins: no vector is split."""
_FEW = 10
"""Vehicles from which on a block takes less time, though it has room for many more."""


class FlightCode(Protocol):
    """Machine code of `aot_source`."""

    def use(self, numbers: bytearray, fixed: bytearray, block: bytearray) -> None:
        """Fly, from now on, the vehicles with these numbers and constants, with room for a block and a LINE."""

    def fly(self, count: int, start: int, steps: int) -> None:
        """Fly the first so many vehicles; steps are counted from `start`, of 1 ms."""


class CompiledModel:
    """`flight_modes.fly`, bit-identical, in machine code, for one thread at a time."""

    def __init__(self, machine: FlightCode) -> None:
        """Fly by this machine code."""
        self._machine, self._fly = machine, machine.fly
        self._fixed, self._block = bytearray(_FIXED.size), bytearray(ROWS * WIDTH * 8 + LINE)
        self._packed: Constants | None = None
        self._make_room(1)

    def _make_room(self, count: int) -> None:
        self._room, self._numbers = count, bytearray(count * _NUMBERS.size)
        self._machine.use(self._numbers, self._fixed, self._block)

    def __call__(
        self,
        state: State,
        command: Motors,
        plan: Plan,
        mode: FlightMode,
        air: Air,
        constants: Constants,
        start: int,
        steps: int,
    ) -> Lane:
        """Do the same as `flight_modes.fly`."""
        if mode[2] >= PERIODS_TO_REST:
            return state, command, plan, mode, air
        (flown,) = self.fly(((state, command, plan, mode, air),), constants, start, steps)
        return flown

    def fly(
        self, lanes: Sequence[Lane], constants: Constants, start: int, steps: int
    ) -> list[Lane]:
        """Return vehicles that share their constants after this many steps of 1 ms, as `flight_modes.fly`."""
        if constants is not self._packed:
            body, gains, mixer, limits, weight, spin_up, weather = constants
            _FIXED.pack_into(
                self._fixed, 0, *body, *gains, *mixer, *limits, weight, spin_up, *weather
            )
            self._packed = constants
        if len(lanes) > self._room:
            self._make_room(len(lanes))
        place = 0
        for state, command, (x, y, z, *others), mode, air in lanes:
            _NUMBERS.pack_into(
                self._numbers, place, *state, *command, *x, *y, *z, *others, *mode, *air
            )
            place += _NUMBERS.size
        self._fly(len(lanes), start, steps)
        flown = memoryview(self._numbers)[:place]
        return [lane_of(numbers) for numbers in _NUMBERS.iter_unpack(flown)]


def lane_of(v: Any) -> Lane:
    """Return a vehicle from its changing numbers, a tuple in the order of a block's rows."""
    plan = (v[21:30], v[30:39], v[39:48], v[48], v[49], v[50], v[51])
    return v[0:17], v[17:21], plan, v[52:60], v[60:69]


def aot_source() -> str:
    """Return a module whose `fly(numbers, fixed, block, count, start, steps)` takes pointers to arrays.

    These are the numbers of each vehicle, their constants, and room for a block.
    """
    return block_source("flight_modes__fly") + _FLY


def _items(array: str, first: int, *counts: int) -> str:
    """Return a tuple of consecutive array items for each count; a count of 0 is a bare item."""
    parts = []
    for count in counts:
        items = [f"{array}[{i}]" for i in range(first, first + (count or 1))]
        parts.append(f"({', '.join(items)})" if count else items[0])
        first += len(items)
    return ", ".join(parts)


_CONSTANTS = tuple(0 if size == 1 else size for size in CONSTANTS.values())
"""Sizes of the constants' tuples, 0 for a number."""

_FLY = f"""
from numba import carray

_doubles = types.CPointer(types.float64)


@njit(error_model='numpy', inline='never')
def _fly_one(v, c, start, steps):
    state, command, plan, mode, air = flight_modes__fly(
        {_items("v", 0, 17, 4)},
        ({_items("v", 21, 9, 9, 9, 0, 0, 0, 0)}),
        {_items("v", 52, 8, 9)},
        ({_items("c", 0, *_CONSTANTS)}),
        start, steps)
    flown = (*state, *command, *plan[0], *plan[1], *plan[2], *plan[3:], *mode, *air)
    for i in range({STORED}):
        v[i] = flown[i]


@njit(error_model='numpy', inline='never')
def _fly_block(v, live, q, c, start, steps):
    for n in range({WIDTH}):
        for i in range({STORED}):
            q[i * {WIDTH} + n] = v[n if n < live else 0, i]
    _advance(q, c, start, steps)
    for n in range(live):
        for i in range({STORED}):
            v[n, i] = q[i * {WIDTH} + n]


@njit(
    types.void(_doubles, _doubles, _doubles, types.int64, types.int64, types.int64),
    error_model='numpy', no_cpython_wrapper=True, no_cfunc_wrapper=True)
def fly(numbers, fixed, block, count, start, steps):
    v = carray(numbers, (count, {STORED}))
    q = carray(block, {ROWS * WIDTH})
    c = carray(fixed, {sum(CONSTANTS.values())})
    if count < {_FEW}:
        for n in range(count):
            _fly_one(v[n], c, start, steps)
    else:
        for n in range(0, count, {WIDTH}):
            _fly_block(v[n:], min(count - n, {WIDTH}), q, c, start, steps)
"""
