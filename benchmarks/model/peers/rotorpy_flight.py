"""Flight of a scenario by rotorpy's equations, solved by DOP853, in rotorpy's environment.

It prints JSON: the version and the 13 numbers of each recorded state.
"""

import json
import sys
from importlib import metadata
from math import sqrt

import numpy as np
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

from benchmarks.model.scenario import COMMAND, FLIGHTS, RECORD, start

_OURS = (0, 3, 2, 1)
"""Our rotors in rotorpy's order, and back."""


def main(name: str) -> None:
    flight = FLIGHTS[name]
    v = flight.vehicle
    lever = v["arm"] / sqrt(2)
    places = ((lever, lever), (lever, -lever), (-lever, -lever), (-lever, lever))
    own = {
        "mass": v["mass"], "Ixx": v["inertia_x"], "Iyy": v["inertia_y"], "Izz": v["inertia_z"],
        "Ixy": 0.0, "Iyz": 0.0, "Ixz": 0.0,
        "c_Dx": v["drag"], "c_Dy": v["drag"], "c_Dz": v["drag"],
        "k_eta": v["thrust"], "k_m": v["torque"], "k_d": v["across"], "k_z": v["along"],
        "k_h": 0.0, "k_flap": 0.0, "tau_m": v["lag"],
        "rotor_speed_min": 0.0, "rotor_speed_max": v["most_speed"], "motor_noise_std": 0.0,
        "rotor_pos": {f"r{i + 1}": np.array([x, y, 0.0]) for i, (x, y) in enumerate(places)},
        "rotor_directions": np.array([1, -1, 1, -1]),
    }  # fmt: skip
    exact = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    multirotor = Multirotor(
        dict(quad_params) | own, aero=True, enable_ground=False, integrator_kwargs=exact
    )
    first = np.array(start(flight))
    state = {
        "x": first[:3], "v": first[3:6], "q": np.roll(first[6:10], -1), "w": first[10:],
        "wind": np.array(flight.wind), "rotor_speeds": np.full(4, flight.hover),
    }  # fmt: skip
    states = []
    for number in range(round(flight.seconds / COMMAND)):
        speeds = np.array(flight.command(number))[list(_OURS)]
        state = multirotor.step(state, {"cmd_motor_speeds": speeds}, COMMAND)
        state["wind"] = np.array(flight.wind)
        if (number + 1) % round(RECORD / COMMAND) == 0:
            parts = state["x"], state["v"], np.roll(state["q"], 1), state["w"]
            states.append(np.concatenate(parts).tolist())
    print(json.dumps({"version": metadata.version("rotorpy"), "states": states}))


if __name__ == "__main__":
    main(sys.argv[1])
