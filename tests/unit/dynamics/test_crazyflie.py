"""Flights of a second vehicle, thirty times lighter and with slow rotors."""

from math import dist, sqrt
from pathlib import Path

import pytest

from quadctl.schemas.params import DynamicsParams, MeanWindParams, Params, StartParams, WindParams
from quadctl.services.dynamics.rotor import hover_speed
from quadctl.services.dynamics.vehicle import Vehicle
from quadctl.services.runtime.params.load import load

FILE = Path(__file__).parents[3] / "examples" / "crazyflie.toml"


@pytest.fixture
def params() -> DynamicsParams:
    return load(FILE).dynamics


def at(params: DynamicsParams, z: float) -> Vehicle:
    params.start = StartParams(0.0, 0.0, z)
    return Vehicle(params)


def test_the_file_sets_only_what_differs_from_the_labs_vehicle(params):
    rest = load(FILE)
    rest.dynamics = DynamicsParams()
    assert rest == Params()
    assert hover_speed(params.vehicle) == pytest.approx(1788.5, abs=0.1)  # 71 % of the limit


def test_the_vehicle_takes_off_and_hovers_at_its_goal(params):
    vehicle = at(params, 0.0)
    vehicle.goto(0.0, 0.0, 1.0)
    vehicle.advance(5000)
    errors = []
    for _ in range(500):
        vehicle.advance(10)
        errors.append(dist(vehicle.position, (0.0, 0.0, 1.0)))
    assert sqrt(sum(e * e for e in errors) / len(errors)) < 1e-4
    assert max(errors) < 1e-3


@pytest.mark.parametrize(
    "goal", [(1.0, 0.0, 1.0), (0.0, -1.0, 1.0), (0.0, 0.0, 2.0), (0.6, 0.0, 1.8)]
)
def test_a_step_of_one_metre_ends_on_the_goal_without_overshoot(params, goal):
    vehicle = at(params, 1.0)
    start = vehicle.position
    vehicle.goto(*goal)
    for _ in range(5000):
        vehicle.advance(1)
        assert dist(vehicle.position, start) <= 1.0 + 1e-3
        assert dist(vehicle.position, vehicle.setpoint) < 0.02
    assert dist(vehicle.position, goal) < 1e-3


def test_the_vehicle_lands_and_takes_off_again(params):
    vehicle = at(params, 1.5)
    vehicle.goto(1.0, 0.0, 0.0)
    vehicle.advance(6000)
    assert vehicle.standing
    vehicle.goto(0.0, 0.0, 1.0)
    vehicle.advance(6000)
    assert dist(vehicle.position, (0.0, 0.0, 1.0)) < 1e-3


def test_the_vehicle_holds_its_place_in_moving_air(params):
    params.wind = WindParams(MeanWindParams(0.5, 0.0, 0.0), gust=0.3, gust_length=1.0)
    vehicle = at(params, 1.0)
    for _ in range(2000):
        vehicle.advance(10)
        assert dist(vehicle.position, (0.0, 0.0, 1.0)) < 0.2
