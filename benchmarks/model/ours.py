"""How fast the model is as plain Python, on arrays and compiled: `python -m benchmarks.model.ours NAME`.

Three things are timed: `dynamics`, the step alone with constant commands; `control`, with the
controller every fourth step, on a setpoint that stands still; and `flight`, with everything: the
setpoint generator, the pilot, and the wind where there is one.
"""

import sys
import time
from collections.abc import Callable

BEGAN = time.perf_counter()
from schemas.params import DynamicsParams, StartParams  # noqa: E402 - the import is timed
from services.dynamics.vehicle import Vehicle, constants_of  # noqa: E402

PLAIN = time.perf_counter() - BEGAN

from benchmarks.model.peers.timing import COUNTS, Rates, rate, tell  # noqa: E402

_STEPS = 100
_FAR = 1e5
"""A goal that no flight here reaches, m."""


def flying() -> DynamicsParams:
    return DynamicsParams(start=StartParams(0.0, 0.0, 1000.0))


def plain() -> None:
    from benchmarks.model.reference import hovering
    from services.dynamics.pilot import act
    from services.dynamics.rigidbody import step

    body, gains, mixer, _, weight, _, _ = constants_of(DynamicsParams())
    start, still = hovering(), (0.0, 0.0, 0.0)
    motors = start[13], start[14], start[15], start[16]
    wanted = (1.0, 0.5, 1000.5) + (0.0,) * 12

    def dynamics(calls: int) -> None:
        state = start
        for _ in range(calls):
            state = step(state, motors, still, body)

    def control(calls: int) -> None:
        state, command = start, motors
        for number in range(calls):
            if number % 4 == 0:
                command = act(state, wanted, 2.0, weight, gains, mixer)
            state = step(state, command, still, body)

    vehicle = Vehicle(flying())
    vehicle.goto(_FAR, _FAR, 1000.0)
    vehicle.advance(1000)
    rates: Rates = {
        "dynamics": {1: rate(dynamics, 1)},
        "control": {1: rate(control, 1)},
        "flight": {1: rate(vehicle.advance, 1)},
    }
    tell(_python(), PLAIN, rates)


def arrays() -> None:
    import numpy as np

    from benchmarks.model.reference import hovering
    from services.dynamics.fleet.arrays import CHUNK, ArrayFleet, on_arrays

    imported = time.perf_counter() - BEGAN
    step, act = on_arrays("rigidbody_step", "pilot_act")
    body, gains, mixer, _, weight, _, _ = constants_of(DynamicsParams())
    wanted = (1.0, 0.5, 1000.5) + (0.0,) * 12
    rates: Rates = {"dynamics": {}, "control": {}, "flight": {}}
    for count in COUNTS:
        sizes = [min(CHUNK, count - first) for first in range(0, count, CHUNK)]
        starts = [tuple(np.full(size, x) for x in hovering()) for size in sizes]

        def run(calls: int, every: int, starts: list[tuple[np.ndarray, ...]] = starts) -> None:
            for state in starts:
                command = state[13:]
                for number in range(calls):
                    if number % 4 == every:
                        command = act(state, wanted, 2.0, weight, gains, mixer)
                    state = step(state, command, (0.0, 0.0, 0.0), body)  # noqa: PLW2901

        rates["dynamics"][count] = rate(lambda calls, run=run: run(calls, -1), count)
        rates["control"][count] = rate(lambda calls, run=run: run(4 * calls, 0), 4 * count)
        fleet = ArrayFleet([flying()] * count)
        for number in range(count):
            fleet.goto(number, _FAR, _FAR - number, 1000.0)
        rates["flight"][count] = rate(
            lambda calls, fleet=fleet: fleet.advance(4 * calls), 4 * count
        )
    tell(f"numpy {np.__version__}", imported, rates)


_ALONE = """
@njit(error_model='numpy', nogil=True, cache=True)
def alone(blocks, constants, steps, every):
    for b in range(blocks.shape[0]):
        for count in range(steps):
            if count % 4 == every:
                _act(blocks[b], constants[b])
            _move(blocks[b], constants[b])
"""


def compiled() -> None:
    import numba

    from services.dynamics.fleet import kernel
    from services.dynamics.fleet.compiled import CompiledFleet
    from services.runtime import generated

    imported = time.perf_counter() - BEGAN
    module = generated.load("benchmark", kernel.source() + _ALONE)
    rates: Rates = {"dynamics": {}, "control": {}, "flight": {}}
    for count in COUNTS:
        fleet = CompiledFleet([flying()] * count, module)
        for number in range(count):
            fleet.goto(number, _FAR, _FAR - number, 1000.0)
        fleet.advance(200)
        blocks, constants = fleet.blocks, fleet.constants

        def run(calls: int, every: int, blocks=blocks, constants=constants) -> None:  # type: ignore[no-untyped-def]
            for _ in range(calls):
                module.alone(blocks, constants, _STEPS, every)

        per_call = count * _STEPS
        rates["flight"][count] = rate(
            lambda calls, fleet=fleet: [fleet.advance(_STEPS) for _ in range(calls)], per_call
        )
        rates["control"][count] = rate(lambda calls, run=run: run(calls, 0), per_call)
        rates["dynamics"][count] = rate(lambda calls, run=run: run(calls, -1), per_call)
    tell(f"numba {numba.__version__}", imported, rates)


def _python() -> str:
    return f"Python {sys.version.split()[0]}"


BACKENDS: dict[str, Callable[[], None]] = {"plain": plain, "arrays": arrays, "compiled": compiled}

if __name__ == "__main__":
    BACKENDS[sys.argv[1]]()
