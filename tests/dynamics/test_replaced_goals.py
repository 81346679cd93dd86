"""Goals inside a cage, replaced every 50 to 500 ms, never take the vehicle more than 10 mm out."""

import random
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from quadctl.schemas.params import DynamicsParams, StartParams
from quadctl.services.dynamics.compiled.fleet import CompiledFleet
from tests.compiled import compiled_kernel
from tests.proofs import Proofs

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
"""Half of what each is wide in x and y, and its height, m."""
BROUGHT = 4.0
"""Seconds of replacing."""
ENDING = 4.0
"""Seconds to come to rest in."""
PERIOD = 50
"""Milliseconds between two setpoints."""
SAMPLE = 10
MARGIN = 0.01


def place(draws: random.Random, cage: Cage) -> tuple[float, float, float]:
    """A goal inside, often on walls, edges and corners."""
    x, y, z = cage
    walls = ((-x, x), (-y, y), (0.0, z))
    found = [draws.choice(wall) if draws.random() < 0.5 else draws.uniform(*wall) for wall in walls]
    return found[0], found[1], found[2]


def flights(kernel: ModuleType, cage: Cage, count: int, seed: int) -> float:
    """The farthest that any of them gets out of the cage, m."""
    draws = random.Random(seed)
    starts = [place(draws, cage) for _ in range(count)]
    fleet = CompiledFleet([DynamicsParams(start=StartParams(*start)) for start in starts], kernel)
    due = [0] * count
    size = np.array(cage)
    low, worst = np.array([-cage[0], -cage[1], 0.0]), 0.0
    for now in range(0, round(1000 * (BROUGHT + ENDING)), PERIOD):
        for number in range(count):
            if due[number] <= now < 1000 * BROUGHT:
                due[number] = now + PERIOD * draws.randint(1, 10)
                if draws.random() < 0.1:
                    fleet.brake(number)
                else:
                    fleet.goto(number, *place(draws, cage))
        for _ in range(PERIOD // SAMPLE):
            fleet.advance(SAMPLE)
            where = fleet.states()[:, :3]
            out = np.maximum(np.maximum(low - where, where - size), 0.0)
            worst = max(worst, float(np.sqrt((out * out).sum(axis=1)).max()))
    return worst


@pytest.fixture(scope="module")
def farthest() -> Callable[[Cage, int, int], float]:
    kernel = compiled_kernel()
    return lambda cage, count, seed: flights(kernel, cage, count, seed)


@pytest.mark.timeout(300)
@pytest.mark.parametrize("cage", CAGES)
def test_2000_flights_of_replaced_goals(farthest, cage: str):
    assert farthest(CAGES[cage], 2000 // len(CAGES), 1) <= MARGIN


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
