"""Goals inside a cage, replaced every 50 to 500 ms, never lead more than 10 mm outside."""

import random
from collections.abc import Callable
from math import inf
from types import ModuleType

import numpy as np
import pytest

from quadctl.schemas.params import DynamicsParams, StartParams
from quadctl.services.campaign.vehicles import Compiled, Plain, VehicleBatch
from quadctl.services.dynamics import flight_modes
from quadctl.services.dynamics.compiled.fleet import CompiledFleet
from quadctl.services.dynamics.vehicle import Vehicle
from tests.support.compiled import compiled_kernel
from tests.support.proofs import Proofs

Point = tuple[float, float, float]


def standing_at(x: float, y: float, z: float) -> Vehicle:
    return Vehicle(DynamicsParams(start=StartParams(x, y, z)))


def extremes(vehicle: Vehicle, seconds: float) -> tuple[Point, Point]:
    """Return the smallest and the greatest x, y and z of the flight."""
    places = []
    for _ in range(round(100 * seconds)):
        vehicle.advance(10)
        places.append(vehicle.position)
    xs, ys, zs = zip(*places, strict=True)
    return (min(xs), min(ys), min(zs)), (max(xs), max(ys), max(zs))


def test_a_braking_axis_keeps_enough_jerk_to_end_its_braking():
    vehicle = standing_at(-4.0, 1.45, 0.84)
    vehicle.goto(6.82, 2.10, 0.98)
    while vehicle.position[0] < 4.8:
        vehicle.advance(10)
    # Most of the limits go to y now; the rest must still stop x before its goal.
    vehicle.goto(7.13, -2.13, 0.0)
    vehicle.advance(100)
    vehicle.brake()
    assert 6.0 < vehicle.goal[0] <= 7.13
    _, most = extremes(vehicle, 4.0)
    assert most[0] < vehicle.goal[0] + 0.001


@pytest.mark.parametrize("seed", [570, 985, *range(30)])
def test_a_goal_in_flight_leads_no_farther_than_braking_or_the_goal(seed: int):
    draw = random.Random(seed)

    def goal() -> Point:
        low, high = draw.choice([(0, 0), (0, 0.1), (0.1, 0.3), (0.3, 1.5)])
        return draw.uniform(-3, 3), draw.uniform(-3, 3), draw.uniform(low, high)

    flown = Plain([DynamicsParams(start=StartParams(0.0, 0.0, draw.choice([0.0, 1.0])))])
    here = np.zeros(3)
    for _ in range(draw.randrange(1, 5)):
        flown.goto(0, *goal())
        here = flown.fly(4 * draw.randrange(5, 500), 1)[0, :3, 0]
    new = goal()
    box = np.array([here, new, *flown.room(0)])
    flown.goto(0, *new)
    flight = flown.fly(12, 100)[:, :3, 0]
    # A flight from the floor climbs to a hop first.
    most = np.maximum(box.max(axis=0), (-inf, -inf, flight_modes.HOP))
    assert (flight > box.min(axis=0) - 0.001).all()
    assert (flight < most + 0.001).all()


def test_a_hop_requested_in_motion_does_not_turn_back():
    vehicle = standing_at(0.0, 0.0, 0.001)
    vehicle.goto(6.0, 0.0, 0.31)
    while vehicle.position[0] < 0.6:
        vehicle.advance(10)
    assert vehicle.position[2] < 0.05
    assert vehicle.velocity[0] > 2
    vehicle.goto(6.0, 1.0, 0.06)
    start, furthest = vehicle.position[0], 0.0
    for _ in range(400):
        vehicle.advance(10)
        furthest = max(furthest, vehicle.position[0])
        assert vehicle.position[0] > furthest - 0.001
    assert start < furthest < 6.001


@pytest.mark.parametrize("corner", [(2.0, 1.0, 0.0), (-0.3, 0.45, 0.0), (0.5, 0.0, 0.05)])
def test_a_landing_from_afar_ends_at_its_goal(corner: Point):
    vehicle = standing_at(-3.6, -4.3, 0.5)
    vehicle.goto(*corner)
    _, most = extremes(vehicle, 6.0)
    assert vehicle.position == pytest.approx(corner, abs=0.002)
    assert most[0] < corner[0] + 0.004
    assert most[1] < corner[1] + 0.004


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((-0.135, 0.167, 0.161), (-0.319, 0.304, 0.573)),
        ((-0.495, 0.183, 0.034), (-0.622, 0.370, 0.282)),
        ((0.0, 0.0, 1.0), (0.15, 0.15, 1.3)),
    ],
)
def test_a_short_diagonal_climb_does_not_overshoot(start: Point, goal: Point):
    vehicle = standing_at(*start)
    vehicle.goto(*goal)
    _, most = extremes(vehicle, 3.0)
    assert most[2] < goal[2] + 0.004


def test_a_long_flat_path_does_not_scrape_the_floor():
    vehicle = standing_at(0.0, 0.0, 0.0)
    vehicle.goto(40.0, 0.0, 0.2)
    vehicle.advance(4000)
    lag = vehicle.setpoint[0] - vehicle.position[0]
    assert vehicle.position[2] > 0.05
    assert abs(lag) < 0.05


@pytest.mark.parametrize("seed", [8, 141])
def test_a_landing_lands_whatever_came_before_it(seed: int):
    assert highest(Plain, 3, seed) < ON_FLOOR


Cage = tuple[float, float, float]

CAGES: dict[str, Cage] = {
    "least cube": (0.25, 0.25, 0.5),
    "small cube": (0.5, 0.5, 1.0),
    "cube": (2.0, 2.0, 4.0),
    "slit": (0.25, 5.0, 2.0),
    "slab": (5.0, 5.0, 0.5),
    "tower": (0.5, 0.5, 8.0),
    "lab": (5.0, 5.0, 2.0),
    "hall": (10.0, 10.0, 10.0),
}
"""Half widths in x and y, and height, m."""
REPLACING = 4.0
"""Seconds during which goals are replaced."""
SETTLING = 4.0
"""Seconds allowed for coming to rest."""
PERIOD = 50
"""Milliseconds between two setpoints."""
SAMPLE = 10
MARGIN = 0.01


def place(draws: random.Random, cage: Cage) -> tuple[float, float, float]:
    """Return a random goal inside, often on walls, edges and corners."""
    x, y, z = cage
    walls = ((-x, x), (-y, y), (0.0, z))
    found = [draws.choice(wall) if draws.random() < 0.5 else draws.uniform(*wall) for wall in walls]
    return found[0], found[1], found[2]


def flights(kernel: ModuleType, cage: Cage, count: int, seed: int) -> float:
    """Return the greatest distance of any vehicle outside the cage, m."""
    draws = random.Random(seed)
    starts = [place(draws, cage) for _ in range(count)]
    fleet = CompiledFleet([DynamicsParams(start=StartParams(*start)) for start in starts], kernel)
    due = [0] * count
    size = np.array(cage)
    low, worst = np.array([-cage[0], -cage[1], 0.0]), 0.0
    for now in range(0, round(1000 * (REPLACING + SETTLING)), PERIOD):
        for number in range(count):
            if due[number] <= now < 1000 * REPLACING:
                due[number] = now + PERIOD * draws.randint(1, 10)
                if draws.random() < 0.1:
                    fleet.brake(number)
                else:
                    fleet.goto(number, *place(draws, cage))
        for _ in range(PERIOD // SAMPLE):
            fleet.fly(SAMPLE)
            where = fleet.states()[:, :3]
            out = np.maximum(np.maximum(low - where, where - size), 0.0)
            worst = max(worst, float(np.sqrt((out * out).sum(axis=1)).max()))
    return worst


ON_FLOOR = 0.001
"""Height (m) below which a vehicle has landed."""
_NEARS = (0.0, 0.0005, 0.003, 0.009, 0.011, 0.05, 1.0)
"""Distances (m) of a goal from the vehicle, about that of a place that needs no hop."""


def highest(make: Callable[[list[DynamicsParams]], VehicleBatch], count: int, seed: int) -> float:
    """Return the greatest height (m) of any vehicle at the end of a landing.

    Each takes off, stops and is sent elsewhere at random times, often during its spin-up.
    """
    draws = random.Random(seed)
    heights = [draws.choice([0.0, 0.0, 0.05, 1.0]) for _ in range(count)]
    fleet = make([DynamicsParams(start=StartParams(0.0, 0.0, z)) for z in heights])
    due, left = [0] * count, [draws.randint(1, 5) for _ in range(count)]
    motion = np.zeros((count, 3))
    motion[:, 2] = heights
    for now in range(0, 14_000, PERIOD):
        for number, (x, y, _) in enumerate(motion):
            if due[number] > now or left[number] < 0:
                continue
            due[number] = now + PERIOD * draws.choice([0, 1, 2, 4, 8, 30])
            if left[number] and draws.random() < 0.4:
                fleet.brake(number)
            else:
                near = draws.choice(_NEARS)
                z = draws.choice([0.0, 0.0, 0.001, 0.05, 0.1, 1.0]) if left[number] else 0.0
                fleet.goto(
                    number, x + draws.uniform(-near, near), y + draws.uniform(-near, near), z
                )
            left[number] -= 1
        motion = fleet.fly(PERIOD, 1)[0, :3].T
    return float(motion[:, 2].max())


@pytest.fixture(scope="module")
def farthest() -> Callable[[Cage, int, int], float]:
    kernel = compiled_kernel()
    return lambda cage, count, seed: flights(kernel, cage, count, seed)


@pytest.mark.thorough
@pytest.mark.parametrize("cage", CAGES)
def test_2000_flights_of_replaced_goals_stay_inside(farthest, cage: str):
    assert farthest(CAGES[cage], 2000 // len(CAGES), 1) <= MARGIN


@pytest.mark.prove
@pytest.mark.timeout(1800)
def test_100_000_landings(proofs: Proofs):
    kernel = compiled_kernel()
    worst = max(highest(lambda params: Compiled(params, kernel), 2000, n) for n in range(50))
    proofs.add("100 000 landings after stops and take-offs", f"{1000 * worst:.1f} mm high", "1 mm")
    assert worst < ON_FLOOR


@pytest.mark.prove
@pytest.mark.timeout(1800)
def test_50_000_flights_of_replaced_goals(farthest, proofs: Proofs):
    worst = {
        name: max(farthest(cage, 625, seed) for seed in range(2, 12))
        for name, cage in CAGES.items()
    }
    where = max(worst, key=worst.__getitem__)
    proofs.add(
        "50 000 flights of replaced goals",
        f"{1000 * worst[where]:.1f} mm at most, in the {where}",
        f"{1000 * MARGIN:g} mm",
    )
    assert worst[where] <= MARGIN
