"""Speed of crazyflow: JAX on the processor, single precision, RK4 at 1 ms, 100 steps a call."""

import time
from importlib import metadata

BEGAN = time.perf_counter()
import jax  # noqa: E402 - the import with all dependencies is timed
import numpy as np  # noqa: E402
from crazyflow.control import Control  # noqa: E402
from crazyflow.sim import Sim  # noqa: E402
from crazyflow.sim.integration import Integrator  # noqa: E402

IMPORTED = time.perf_counter() - BEGAN

from benchmarks.model.peers.timing import COUNTS, rate, tell  # noqa: E402

_STEPS = 100
_HOVER = 15_000.0


def main() -> None:
    rates: dict[str, dict[int, float]] = {"dynamics": {}, "control": {}}
    for count in COUNTS:
        rates["dynamics"][count] = measured(count, Control.rotor_vel)
        rates["control"][count] = measured(count, Control.state)
    tell(metadata.version("crazyflow"), IMPORTED, rates)


def measured(count: int, control: Control) -> float:
    """Return vehicle-steps per second, with constant rotor speeds or the controller at 250 Hz."""
    simulation = Sim(
        n_worlds=count, n_drones=1, control=control, integrator=Integrator.rk4, freq=1000,
        state_freq=250, attitude_freq=250, body_rate_freq=250, force_torque_freq=250, device="cpu",
    )  # fmt: skip
    simulation.reset()
    if control == Control.state:
        wanted = np.zeros((count, 1, 16), dtype=np.float32)
        wanted[..., 2], wanted[..., 12] = 0.5, 1.0
        simulation.state_control(wanted)
    else:
        simulation.rotor_vel_control(np.full((count, 1, 4), _HOVER, dtype=np.float32))

    def run(calls: int) -> None:
        for _ in range(calls):
            simulation.step(_STEPS)
        jax.block_until_ready(simulation.data)

    return rate(run, count * _STEPS)


if __name__ == "__main__":
    main()
