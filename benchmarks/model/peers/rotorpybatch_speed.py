"""Speed of rotorpy for many vehicles at 1 ms: torch in double precision, RK4, one thread."""

import time
from importlib import metadata

BEGAN = time.perf_counter()
import torch  # noqa: E402 - the import with all dependencies is timed
from rotorpy.controllers.quadrotor_control import BatchedSE3Control  # noqa: E402
from rotorpy.vehicles.hummingbird_params import quad_params  # noqa: E402
from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams  # noqa: E402

IMPORTED = time.perf_counter() - BEGAN

from benchmarks.model.peers.timing import rate, tell  # noqa: E402

_STEP, _CONTROL = 0.001, 4
_COUNTS = (1, 10, 100, 1000, 10_000)
"""Numbers of vehicles; 100 000 would take rotorpy minutes to set up."""


def main() -> None:
    torch.set_num_threads(1)
    rates: dict[str, dict[int, float]] = {"dynamics": {}, "control": {}}
    for count in _COUNTS:
        alone, controlled = fleet(count)
        rates["dynamics"][count] = rate(alone, count)
        rates["control"][count] = rate(controlled, count)
    tell(metadata.version("rotorpy"), IMPORTED, rates)


def fleet(count: int):
    """Return two runs of `count` vehicles: constant commands, and a controller every 4 ms."""
    hover = float((quad_params["mass"] * 9.81 / 4 / quad_params["k_eta"]) ** 0.5)
    device = torch.device("cpu")
    params = BatchedMultirotorParams([dict(quad_params) for _ in range(count)], count, device)

    def start():
        return {
            "x": torch.tensor([0.0, 0.0, 1000.0]).repeat(count, 1).double(),
            "v": torch.zeros(count, 3).double(),
            "q": torch.tensor([0.0, 0.0, 0.0, 1.0]).repeat(count, 1).double(),
            "w": torch.full((count, 3), 0.1).double(),
            "wind": torch.zeros(count, 3).double(),
            "rotor_speeds": torch.full((count, 4), hover).double(),
        }

    vehicles = BatchedMultirotor(params, count, start(), device, integrator="rk4")
    controller = BatchedSE3Control(params, count, device)
    command = {"cmd_motor_speeds": torch.full((count, 4), hover).double()}
    flat = {
        name: torch.zeros(count, 3).double() for name in ("x_dot", "x_ddot", "x_dddot", "x_ddddot")
    } | {name: torch.zeros(count).double() for name in ("yaw", "yaw_dot", "yaw_ddot")}
    flat["x"] = start()["x"]

    def alone(calls: int) -> None:
        state = start()
        for _ in range(calls):
            state = vehicles.step(state, command, _STEP)

    def controlled(calls: int) -> None:
        state, wanted = start(), command
        for number in range(calls):
            if number % _CONTROL == 0:
                wanted = controller.update(0.0, state, flat)
            state = vehicles.step(state, wanted, _STEP)

    return alone, controlled


if __name__ == "__main__":
    main()
