"""The integration against DOP853, and against rotorpy's and mujoco's flights.

The flights were made by `python -m benchmarks.model.crosscheck`, which also compares them again.
"""

import json
from math import dist
from pathlib import Path

import numpy as np
import pytest

from benchmarks.model import flown, scenario
from quadctl.schemas.params import DynamicsParams, MeanWindParams, StartParams, WindParams
from quadctl.schemas.vehicle import InertiaParams, RotorDragParams, VehicleParams
from quadctl.services.dynamics import flight_modes
from quadctl.services.dynamics.rigidbody import State, body_constants, step
from quadctl.services.dynamics.vehicle import Vehicle, constants_of, initial
from tests.support.reference import Reference, angle

LEVEL = (1.0, 0.0, 0.0, 0.0)
OFF = (0.0, 0.0, 0.0, 0.0)
HIGH = (0.0, 0.0, 1000.0)
"""Far above the floor, which would silently change a flight that touches it."""
DRAGGED = VehicleParams(
    drag=0.05, linear_drag=0.2, rotor_drag=RotorDragParams(across=8e-5, along=5e-5)
)
DATA = Path(__file__).parent / "data"


def run(state: State, steps: int, vehicle: VehicleParams, command, wind=(0.0, 0.0, 0.0)) -> State:
    body = body_constants(vehicle)
    for _ in range(steps):
        state = step(state, command, wind, body)
    return state


@pytest.mark.parametrize(
    ("inertia", "rates"),
    [((0.004, 0.0049, 0.0069), (3.0, 0.1, 4.0)), ((0.002, 0.004, 0.006), (0.05, 12.0, 0.05))],
    ids=["tumbling", "about the middle axis, which flips"],
)
def test_ten_seconds_of_tumbling_match_the_attitude_of_dop853(inertia, rates):
    vehicle = VehicleParams(inertia=InertiaParams(*inertia), gravity=0.0, drag=0.0)
    start = (*HIGH, 0.0, 0.0, 0.0, *LEVEL, *rates, *OFF)
    exact = Reference(vehicle).fly(start, OFF, 10.0)
    end = run(start, 10_000, vehicle, OFF)
    assert angle(end[6:10], exact[6:10]) < 1e-8
    assert dist(end[10:13], exact[10:13]) < 1e-8


def test_open_loop_with_all_drag_and_wind_matches_dop853():
    start = (1.0, 2.0, 1000.0, 1.0, -2.0, 0.5, *LEVEL, 0.1, 0.2, 0.3, 900.0, 1000.0, 1100.0, 1200.0)
    command, wind = (1210.0, 1160.0, 1150.0, 1200.0), (2.0, -1.0, 0.5)
    exact = Reference(DRAGGED, wind).fly(start, command, 2.0)
    end = run(start, 2000, DRAGGED, command, wind)
    assert dist(end[:3], exact[:3]) < 2e-9
    assert dist(end[:13], exact[:13]) < 2e-8


@pytest.mark.thorough
@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (3.0, -2.0, 0.5)], ids=["calm", "windy"])
def test_five_seconds_to_a_waypoint_match_dop853(wind):
    params = DynamicsParams(
        start=StartParams(0.0, 0.0, 1.0), wind=WindParams(mean=MeanWindParams(*wind))
    )
    vehicle, reference = Vehicle(params), Reference(params.vehicle, wind)
    constants = constants_of(params)
    state, command, plan, mode, air = initial(params)
    plan, mode = flight_modes.goto(plan, mode, 3.0, 2.0, 2.0, constants[5], constants[3])
    vehicle.goto(3.0, 2.0, 2.0)
    worst = 0.0
    for _ in range(1250):
        command, plan, mode, air = flight_modes.control_period(
            state, command, plan, mode, air, constants
        )
        state = tuple(reference.fly(state, command, 0.004).tolist())
        vehicle.advance(4)
        worst = max(worst, dist(vehicle.position, state[:3]))
    assert worst < 1e-8


@pytest.mark.parametrize("name", scenario.FLIGHTS)
def test_a_flight_of_another_simulator_is_matched(name: str):
    recorded = json.loads((DATA / f"{name}.json").read_bytes())
    flight = scenario.FLIGHTS[name]
    assert recorded["parameters"] == scenario.digest(flight), (
        "record the flight again: see the docstring"
    )
    ours = np.array(flown.fly(flight))
    theirs = np.array(recorded["states"])
    assert ours.shape == theirs.shape
    assert np.abs(ours[:, :3] - theirs[:, :3]).max() < flight.metres
    assert np.abs(ours[:, 3:6] - theirs[:, 3:6]).max() < flight.metres * 10
    assert max(map(angle, ours[:, 6:10], theirs[:, 6:10])) < flight.metres * 10
