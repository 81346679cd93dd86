"""One vehicle, compiled: the model's unchanged source over one array of the vehicle's numbers."""

import ast
from collections.abc import Callable
from struct import Struct
from typing import Any

from quadctl.services.dynamics.compiled.kernel import CONSTANTS, STORED
from quadctl.services.dynamics.compiled.source import merged
from quadctl.services.dynamics.flight_modes import PERIODS_TO_REST, Constants, FlightMode
from quadctl.services.dynamics.rigidbody import Motors, State
from quadctl.services.dynamics.trajectory import Plan
from quadctl.services.dynamics.vehicle import Lane
from quadctl.services.dynamics.wind import Air

Step = Callable[[int, int], object]
"""Runs the compiled code on the numbers: the first step since boot, and the number of steps."""

NUMBERS = Struct(f"{STORED}d")
"""The changing numbers of a vehicle: state, command, plan, mode and air."""
FIXED = Struct(f"{sum(CONSTANTS.values())}d")
"""Its constants, in the order of CONSTANTS."""


class Single:
    """`flight_modes.fly`, bit-identical, in compiled code; each vehicle needs its own instance."""

    def __init__(self, step: Step, numbers: Any, fixed: Any) -> None:
        """Use `step`, which works on these two buffers, of the sizes of NUMBERS and FIXED."""
        self._step, self._numbers, self._fixed = step, numbers, fixed
        self._packed: Constants | None = None

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
        if constants is not self._packed:
            body, gains, mixer, limits, weight, spin_up, weather = constants
            FIXED.pack_into(
                self._fixed, 0, *body, *gains, *mixer, *limits, weight, spin_up, *weather
            )
            self._packed = constants
        x, y, z, *others = plan
        NUMBERS.pack_into(self._numbers, 0, *state, *command, *x, *y, *z, *others, *mode, *air)
        self._step(start, steps)
        return lane_of(NUMBERS.unpack(self._numbers))


def lane_of(v: Any) -> Lane:
    """Return a vehicle from its changing numbers, a tuple in the order of a block's rows."""
    plan = (v[21:30], v[30:39], v[39:48], v[48], v[49], v[50], v[51])
    return v[0:17], v[17:21], plan, v[52:60], v[60:69]


def single_source() -> str:
    """Return a module whose `fly(numbers, fixed, start, steps)` takes pointers to the arrays."""
    text = [
        f"@njit(error_model='numpy')\n{ast.unparse(each)}" for each in merged(["flight_modes__fly"])
    ]
    return "\n".join([_HEAD, *text, _FLY])


def _items(array: str, first: int, *counts: int) -> str:
    """Return a tuple of consecutive array items for each count; a count of 0 is a bare item."""
    parts = []
    for count in counts:
        items = [f"{array}[{i}]" for i in range(first, first + (count or 1))]
        parts.append(f"({', '.join(items)})" if count else items[0])
        first += len(items)
    return ", ".join(parts)


_HEAD = """
from math import sqrt
from numba import carray, njit, types
"""

_CONSTANTS = tuple(0 if size == 1 else size for size in CONSTANTS.values())
"""Sizes of the constants' tuples, 0 for a number."""

_FLY = f"""
_doubles = types.CPointer(types.float64)


@njit(
    types.void(_doubles, _doubles, types.int64, types.int64),
    error_model='numpy', no_cpython_wrapper=True, no_cfunc_wrapper=True)
def fly(numbers, fixed, start, steps):
    q = carray(numbers, {STORED})
    c = carray(fixed, {sum(CONSTANTS.values())})
    state, command, plan, mode, air = flight_modes__fly(
        {_items("q", 0, 17, 4)},
        ({_items("q", 21, 9, 9, 9, 0, 0, 0, 0)}),
        {_items("q", 52, 8, 9)},
        ({_items("c", 0, *_CONSTANTS)}),
        start, steps)
    flown = (*state, *command, *plan[0], *plan[1], *plan[2], *plan[3:], *mode, *air)
    for i in range({STORED}):
        q[i] = flown[i]
"""
