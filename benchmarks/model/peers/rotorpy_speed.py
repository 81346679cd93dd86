"""Speed of rotorpy for one vehicle at 1 ms, as fast as its options make it.

That is scipy's RK45 with loose tolerances and the whole step tried first, without air.
"""

import time
from importlib import metadata

BEGAN = time.perf_counter()
import numpy as np  # noqa: E402 - the import with all dependencies is timed
from rotorpy.controllers.quadrotor_control import SE3Control  # noqa: E402
from rotorpy.trajectories.hover_traj import HoverTraj  # noqa: E402
from rotorpy.vehicles.hummingbird_params import quad_params  # noqa: E402
from rotorpy.vehicles.multirotor import Multirotor  # noqa: E402

IMPORTED = time.perf_counter() - BEGAN

from benchmarks.model.peers.timing import rate, tell  # noqa: E402

_STEP, _CONTROL = 0.001, 4


def main() -> None:
    hover = np.sqrt(quad_params["mass"] * 9.81 / 4 / quad_params["k_eta"])
    start = {
        "x": np.array([0.0, 0.0, 1000.0]), "v": np.zeros(3), "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.array([0.1, 0.2, 0.05]), "wind": np.zeros(3), "rotor_speeds": np.full(4, hover),
    }  # fmt: skip
    loose = {"method": "RK45", "rtol": 1e-2, "atol": 1e-2, "first_step": _STEP}
    vehicle = Multirotor(
        quad_params, dict(start), aero=False, enable_ground=False, integrator_kwargs=loose
    )
    controller, hovering = SE3Control(quad_params), HoverTraj(np.array([0.0, 0.0, 1000.0]))
    command = {"cmd_motor_speeds": np.full(4, hover)}

    def alone(calls: int) -> None:
        state = dict(start)
        for _ in range(calls):
            state = vehicle.step(state, command, _STEP)

    def controlled(calls: int) -> None:
        state, wanted = dict(start), command
        for number in range(calls):
            if number % _CONTROL == 0:
                wanted = controller.update(0.0, state, hovering.update(0.0))
            state = vehicle.step(state, wanted, _STEP)

    rates = {"dynamics": {1: rate(alone, 1)}, "control": {1: rate(controlled, 1)}}
    tell(metadata.version("rotorpy"), IMPORTED, rates)


if __name__ == "__main__":
    main()
