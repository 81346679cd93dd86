"""Goals moved in flight, on the walls among them, never take the vehicle out of the cage."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics.vehicle import Vehicle
from tests.dynamics.path import Path

SIZE = (5.0, 5.0, 2.0)
AXIS = st.sampled_from([-1.0, 0.0, 1.0]) | st.floats(-1.0, 1.0)
HEIGHT = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
GOAL = st.tuples(AXIS.map(lambda n: 5 * n), AXIS.map(lambda n: 5 * n), HEIGHT.map(lambda n: 2 * n))


def excursion(position):
    """How far a point is out of the cage, m; negative inside."""
    x, y, z = position
    return max(abs(x) - SIZE[0], abs(y) - SIZE[1], z - SIZE[2], -z)


@settings(max_examples=40)
@given(st.lists(st.tuples(GOAL, st.integers(1, 400)), min_size=2, max_size=8))
def test_the_setpoint_stays_inside_wherever_the_goal_moves(moves):
    setpoint = Path(DynamicsParams(), (0.0, 0.0, 1.0))
    worst = -1.0
    for goal, periods in moves:
        setpoint.goto(*goal)
        for _ in range(periods):
            setpoint.advance()
            worst = max(worst, excursion(setpoint.setpoint[:3]))
    assert worst <= 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_the_setpoint_stays_inside_on_random_missions(seed):
    rng = random.Random(seed)
    worst = -1.0
    for _ in range(60):
        setpoint = Path(DynamicsParams(), (0.0, 0.0, 1.0))
        for _ in range(8):
            setpoint.goto(wall(rng, 5.0), wall(rng, 5.0), rng.choice((0.0, 2.0, rng.uniform(0, 2))))
            for _ in range(rng.choice((1, rng.randint(1, 300)))):
                setpoint.advance()
                worst = max(worst, excursion(setpoint.setpoint[:3]))
    assert worst <= 1e-6


def wall(rng, size):
    """A coordinate, often on a wall or in the middle."""
    return rng.choice((-size, 0.0, size)) if rng.random() < 0.6 else rng.uniform(-size, size)


@pytest.mark.parametrize("seed", range(3))
def test_the_vehicle_stays_inside_to_a_centimetre(seed):
    rng = random.Random(seed)
    vehicle = Vehicle(DynamicsParams())
    vehicle.goto(0.0, 0.0, 1.0)
    vehicle.advance(1500)
    worst = -1.0
    for _ in range(6):
        vehicle.goto(wall(rng, 5.0), wall(rng, 5.0), rng.choice((2.0, rng.uniform(0.2, 2.0))))
        for _ in range(rng.randint(20, 250)):
            vehicle.advance(10)
            worst = max(worst, excursion(vehicle.position))
    assert worst <= 0.01
