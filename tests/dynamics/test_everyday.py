"""The control period of arrays and what it leaves, against the one of a vehicle alone."""

import random

import pytest

from services.dynamics.everyday import period, remainder
from services.dynamics.pilot import PERIODS_TO_REST, control_period
from services.dynamics.vehicle import Vehicle, constants_of
from tests.dynamics.test_fleets import vehicles


@pytest.mark.parametrize("number", range(3))
def test_what_it_leaves_makes_it_whole(number: int):
    draws, params = random.Random(number), vehicles(3, 7)[number]
    vehicle, constants, left = Vehicle(params), constants_of(params), 0
    for count in range(2500):
        if count % 300 == 0:
            vehicle.goto(draws.uniform(-1, 1), draws.uniform(-1, 1), draws.choice([0.0, 0.05, 1.0]))
        state, command, plan, mode, air = (
            vehicle._state, vehicle._command, vehicle._plan, vehicle._mode, vehicle._air,
        )  # fmt: skip
        if mode[2] < PERIODS_TO_REST:
            whole = control_period(state, command, plan, mode, air, constants)
            command, plan, mode, air, waits = period(state, plan, mode, air, constants)
            if waits:
                plan, mode = remainder(state, command, plan, mode, constants[3])
                left += 1
            assert repr((command, plan, mode, air)) == repr(whole)
        vehicle.advance(4)
    assert 0 < left < 250
