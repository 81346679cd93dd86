"""Speed of the model as plain Python and compiled: `python -m benchmarks.model.ours NAME`.

Three things are timed: `dynamics`, the step alone with constant commands; `control`, with the
controller every fourth step, on a constant setpoint; and `flight`, with everything: the
setpoint generator, the pilot, and the wind if there is any.
"""

import sys
import time
from collections.abc import Callable

BEGAN = time.perf_counter()
from quadctl.schemas.params import DynamicsParams  # noqa: E402 - the import is timed
from quadctl.services.dynamics.vehicle import Vehicle, constants_of  # noqa: E402

PLAIN = time.perf_counter() - BEGAN

from benchmarks.model.peers.timing import COUNTS, Rates, rate, tell  # noqa: E402
from benchmarks.model.vehicles import FAR, STEPS, flying  # noqa: E402


def plain() -> None:
    from benchmarks.model.reference import hovering
    from quadctl.services.dynamics.flight_modes import motor_commands
    from quadctl.services.dynamics.rigidbody import step
    from quadctl.services.dynamics.trajectory import resting, setpoint_of

    body, gains, mixer, limits, weight, _, _ = constants_of(DynamicsParams())
    start, still = hovering(), (0.0, 0.0, 0.0)
    motors = start[13], start[14], start[15], start[16]
    wanted = setpoint_of(resting(1.0, 0.5, 1000.5, limits), limits)

    def dynamics(calls: int) -> None:
        state = start
        for _ in range(calls):
            state = step(state, motors, still, body)

    def control(calls: int) -> None:
        state, command = start, motors
        for number in range(calls):
            if number % 4 == 0:
                command = motor_commands(state, wanted, 2.0, weight, gains, mixer)
            state = step(state, command, still, body)

    vehicle = Vehicle(flying())
    vehicle.goto(FAR, FAR, 1000.0)
    vehicle.advance(1000)
    rates: Rates = {
        "dynamics": {1: rate(dynamics, 1)},
        "control": {1: rate(control, 1)},
        "flight": {1: rate(vehicle.advance, 1)},
    }
    tell(_python(), PLAIN, rates)


def compiled() -> None:
    import numba

    from benchmarks.model import alone

    imported = time.perf_counter() - BEGAN
    module = alone.compiled()
    rates: Rates = {"dynamics": {}, "control": {}, "flight": {}}
    for count in COUNTS:
        fleet, run = alone.on_their_way(count, module)
        per_call = count * STEPS
        rates["flight"][count] = rate(
            lambda calls, fleet=fleet: [fleet.fly(STEPS) for _ in range(calls)], per_call
        )
        rates["control"][count] = rate(lambda calls, run=run: run(calls, 0), per_call)
        rates["dynamics"][count] = rate(lambda calls, run=run: run(calls, -1), per_call)
    tell(f"numba {numba.__version__}", imported, rates)


def _python() -> str:
    return f"Python {sys.version.split()[0]}"


BACKENDS: dict[str, Callable[[], None]] = {"plain": plain, "compiled": compiled}

if __name__ == "__main__":
    BACKENDS[sys.argv[1]]()
