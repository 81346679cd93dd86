"""Branchless setpoint step against the plain trajectory, on flights of every kind."""

import random
from collections import Counter

import pytest

from quadctl.services.dynamics import trajectory
from quadctl.services.dynamics.compiled.branchless import NOTHING, PLAIN, RARE, glide
from quadctl.services.dynamics.vehicle import Vehicle, constants_of
from tests.unit.dynamics.compiled.test_fleet import vehicles


@pytest.mark.thorough
@pytest.mark.parametrize(
    "number", [0, *(pytest.param(number, marks=pytest.mark.thorough) for number in (1, 2))]
)
def test_each_step_equals_the_trajectory_to_the_bit_or_is_rare(number: int):
    draws, params = random.Random(number), vehicles(3, 7)[number]
    vehicle, limits, found = Vehicle(params), constants_of(params)[3], Counter[float]()
    for count in range(4500):
        # Some goals are replaced in flight; the vehicle comes to rest at the last one.
        if count % 300 == 0 and count < 3000:
            vehicle.goto(draws.uniform(-1, 1), draws.uniform(-1, 1), draws.choice([0.0, 0.05, 1.0]))
        plan = vehicle._plan
        after, kind = glide(plan, limits)
        if kind == PLAIN:
            assert repr(after) == repr(trajectory.advance(plan, limits))
        elif kind == NOTHING:
            assert repr(plan) == repr(trajectory.advance(plan, limits))
        found[kind] += 1
        vehicle.advance(4)
    assert found[PLAIN] > 1000
    assert found[NOTHING]
    assert 0 < found[RARE] < 250
