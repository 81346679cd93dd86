"""Speed of mujoco: Runge-Kutta of order four at 1 ms, in C, exact motor lag, no air, no floor."""

import time

BEGAN = time.perf_counter()
import mujoco  # noqa: E402 - its import is timed
import numpy as np  # noqa: E402
from mujoco import rollout  # noqa: E402

IMPORTED = time.perf_counter() - BEGAN

from benchmarks.model.peers.mujoco_model import xml  # noqa: E402
from benchmarks.model.peers.timing import COUNTS, rate, tell  # noqa: E402
from benchmarks.model.scenario import FLIGHTS  # noqa: E402

_STEPS = 20


def main() -> None:
    vehicle = FLIGHTS["rotorpy"].vehicle
    model = mujoco.MjModel.from_xml_string(xml(vehicle, "RK4", lag=True))
    data = mujoco.MjData(model)
    hover = vehicle["mass"] * vehicle["gravity"] / 4
    data.ctrl[:] = data.act[:] = hover
    data.qpos[2] = 1000.0
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    rates = {1: rate(lambda calls: mujoco.mj_step(model, data, calls), 1)}
    for count in COUNTS[1:]:
        states = np.tile(state, (count, 1))
        control = np.full((count, _STEPS, 4), hover)

        def run(calls: int, states=states, control=control) -> None:
            for _ in range(calls):
                rollout.rollout(model, data, states, control, nstep=_STEPS)

        rates[count] = rate(run, count * _STEPS)
    tell(mujoco.__version__, IMPORTED, {"dynamics": rates})


if __name__ == "__main__":
    main()
