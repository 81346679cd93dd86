"""Flight of a scenario by mujoco's Runge-Kutta of order four at 1 ms, in mujoco's environment.

It prints JSON: the version and the 13 numbers of each recorded state.
"""

import json
import sys

import mujoco
import numpy as np

from benchmarks.model.peers.mujoco_model import xml
from benchmarks.model.scenario import COMMAND, FLIGHTS, RECORD, start

_STEP = 0.001


def main(name: str) -> None:
    flight = FLIGHTS[name]
    v = flight.vehicle
    model = mujoco.MjModel.from_xml_string(xml(v, "RK4", lag=False))
    data = mujoco.MjData(model)
    first = start(flight)
    data.qpos[:] = (*first[:3], *first[6:10])
    data.qvel[:] = (*first[3:6], *first[10:])
    states = []
    for number in range(round(flight.seconds / COMMAND)):
        data.ctrl[:] = [v["thrust"] * speed * speed for speed in flight.command(number)]
        mujoco.mj_step(model, data, round(COMMAND / _STEP))
        if (number + 1) % round(RECORD / COMMAND) == 0:
            parts = data.qpos[:3], data.qvel[:3], data.qpos[3:], data.qvel[3:]
            states.append(np.concatenate(parts).tolist())
    print(json.dumps({"version": mujoco.__version__, "states": states}))


if __name__ == "__main__":
    main(sys.argv[1])
