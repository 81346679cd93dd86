"""Bodies and limits at the edge of what can be flown: within 10 mm of the cage, or refused."""

from itertools import product
from random import Random
from typing import Any

import pytest
from msgspec import inspect

from quadctl.schemas import airworthy
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import Conditions, mission
from quadctl.services.campaign.vehicles import Compiled
from quadctl.services.runtime.params import catalogue
from tests.support.compiled import compiled_kernel

MOST = 0.01


def excursion(given: dict[str, Any], flights: int) -> float | None:
    """Return how far (m) the worst of random flights left the cage, None if refused."""
    conditions = Conditions(20.0, faults=False, given=given)
    first = mission(0, Random(0), conditions).dynamics
    if airworthy.why_not(first.vehicle, first.control, first.wind):
        return None
    module = compiled_kernel()
    made = [mission(seed, Random(seed), conditions) for seed in range(flights)]
    flown = Batch(made, lambda params: Compiled(params, module)).fly()
    return max(flight.worst_excursion for flight in flown)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("control.max_acceleration", 8.0),
        ("control.max_acceleration", 10.0),
        ("control.max_acceleration", 20.0),
        ("control.max_tilt", 0.3),
        ("control.max_jerk", 200.0),
        ("vehicle.mass", 3.0),
        ("vehicle.mass", 0.7),
        ("vehicle.drag", 0.2),
    ],
)
def test_limits_beyond_the_body_keep_300_flights_inside(name: str, value: float):
    found = excursion({f"dynamics.{name}": value}, 300)
    assert found is not None
    assert found < MOST


NAMES = (
    "inertia.x", "inertia.y", "inertia.z", "arm", "thrust_coefficient", "torque_coefficient",
    "max_motor_speed",
)  # fmt: skip


@pytest.mark.parametrize(("name", "part"), list(product(NAMES, (0.0, 0.25, 0.5, 0.75, 1.0))))
def test_a_body_flies_inside_or_is_refused(name: str, part: float):
    full = f"dynamics.vehicle.{name}"
    bounds = catalogue.leaves()[full].type
    assert isinstance(bounds, inspect.FloatType)
    low, high = float(bounds.ge or 0), float(bounds.le or 0)
    found = excursion({full: low * (high / low) ** part}, 20)
    assert found is None or found < MOST


def test_the_lab_vehicle_flies_its_own_limits():
    dynamics = mission(0, Random(0), Conditions(20.0)).dynamics
    body = dynamics.vehicle, dynamics.control, dynamics.wind
    limits = dynamics.control
    assert airworthy.flown(*body)._replace(acceleration_at_speed=0.0) == (
        limits.max_speed, limits.max_acceleration, 0.0, limits.max_jerk,
    )  # fmt: skip
    assert airworthy.limited(*body) == []
