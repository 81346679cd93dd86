"""Bodies and limits at the edge of what can be flown: within 10 mm of the cage, or refused."""

import time
from itertools import product
from random import Random
from typing import Any

import numpy as np
import pytest
from msgspec import inspect, structs

from quadctl.schemas import airworthy
from quadctl.schemas.params import (
    FROM_STANDSTILL,
    CageParams,
    DynamicsParams,
    SafetyParams,
    StartParams,
)
from quadctl.services.campaign import search
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import Conditions, GotoEvent, Param, mission
from quadctl.services.campaign.vehicles import Compiled
from quadctl.services.runtime.params import catalogue
from tests.support.compiled import compiled_kernel
from tests.support.proofs import Proofs

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


LIVE = [
    name
    for name, entry in catalogue.leaves().items()
    if name.startswith(FROM_STANDSTILL) and isinstance(entry.type, inspect.FloatType)
]
MOMENTS = (0.5, 1.1, 1.5, 1.9, 2.6)
"""Times (s) in a flight to two walls at once: it gathers speed, cruises, brakes, arrives."""
WALLS = ((5.0, 3.0, 2.0), (-5.0, -3.0, 0.0), (5.0, -3.0, 2.0), (-5.0, 3.0, 2.0))


def five_values(name: str) -> list[float]:
    """Return a parameter's bounds, and three values between them."""
    bounds = catalogue.leaves()[name].type
    assert isinstance(bounds, inspect.FloatType)
    low, high = float(bounds.ge or 0), float(bounds.le or 0)
    least = low or 1e-6 * high
    return [low, *(least * (high / least) ** (part / 4) for part in range(1, 4)), high]


@pytest.mark.parametrize("name", LIVE)
def test_a_parameter_set_in_flight_keeps_it_inside_or_is_refused(name: str):
    module = compiled_kernel()
    plain = mission(0, Random(0), Conditions(14.0))
    safety = SafetyParams(virtual_cage=CageParams(5.0, 5.0, 2.0))
    dynamics = DynamicsParams(start=StartParams(-4.0, 0.0, 1.0))
    flights = [
        structs.replace(
            plain,
            seconds=14.0,
            safety=safety,
            dynamics=dynamics,
            rows=(
                GotoEvent(0.2, *WALLS[0], replace=False),
                Param(moment, name, value),
                # From here on it flies by the new value, if that was not refused.
                *(GotoEvent(5.0 + 1.3 * n, *WALLS[1 + n % 3], replace=True) for n in range(6)),
            ),
        )
        for value in five_values(name)
        for moment in MOMENTS
    ]
    batch = Batch(flights, lambda params: Compiled(params, module))
    flown = batch.fly()
    assert not [flight.violations for flight in flown if flight.violations]
    assert max(flight.worst_excursion for flight in flown) < MOST


def test_goals_replaced_back_and_forth_in_thick_air_keep_it_inside():
    # Its setpoint was led to 0.72 m/s, by accelerations that a new share took long to end, where
    # 0.4 m/s was the limit and 0.77 m/s all that its tilt can hold: it drifted out by 15 mm.
    plain = mission(0, Random(0), Conditions(5.0, given={"dynamics.vehicle.linear_drag": 8.9566}))
    flight = structs.replace(
        plain,
        safety=SafetyParams(virtual_cage=CageParams(20.0, 20.0, 20.0)),
        dynamics=structs.replace(plain.dynamics, start=StartParams(-20.0, -17.22, 20.0)),
        rows=(
            GotoEvent(0.15, -18.904, -10.267, 11.327, replace=True),
            GotoEvent(0.45, -0.955, 14.361, 14.526, replace=True),
            GotoEvent(0.6, -20.0, -20.0, 0.0, replace=True),
        ),
    )
    module = compiled_kernel()
    (flown,) = Batch([flight], lambda params: Compiled(params, module)).fly()
    assert not flown.violations
    assert flown.worst_excursion < 0.001


CAGES = ((0.2, 0.2, 0.2), *search.CAGES, (20.0, 20.0, 20.0))


def random_body(draws: Random) -> dict[str, float]:
    """Return one to four parameters with values anywhere within their bounds."""
    found = {}
    for name in draws.sample(LIVE, draws.choice((1, 1, 2, 3, 4))):
        default, bounds = catalogue.leaves()[name].default, five_values(name)
        near = draws.random() < 0.5 and default > 0
        least = bounds[0] or 1e-6 * bounds[-1]
        value = (
            default * 8 ** draws.uniform(-1, 1)
            if near
            else least * ((bounds[-1] / least) ** draws.random())
        )
        found[name] = min(max(value, bounds[0]), bounds[-1])
    return found


def fuzzed(seed: int, bodies: int) -> tuple[float, dict[str, float], int]:
    """Return the worst excursion (m) of random bodies, that body, and the number not refused.

    Each flies 64 random missions of the search. Jerks under 5 m/s^3 are left out, and what is faster
    than safety expects of a vehicle.
    """
    draws, module = Random(seed), compiled_kernel()
    worst, farthest, accepted = 0.0, {}, 0
    for _ in range(bodies):
        given = random_body(draws)
        if given.get("dynamics.control.max_jerk", 5.0) < 5.0:
            continue
        genes = np.random.default_rng(draws.randrange(2**31))
        conditions = Conditions(14.0, faults=False, given=given)
        flights = [
            search.decode(
                genes.random(search.GENOME),
                search.Surroundings(draws.choice(CAGES), (0.0, 0.0), 0, None),
                conditions,
                number,
            )
            for number in range(64)
        ]
        body = flights[0].dynamics
        if airworthy.why_not(body.vehicle, body.control, body.wind):
            continue
        limits = airworthy.flown(body.vehicle, body.control, body.wind)
        if limits.max_speed > flights[0].safety.max_speed:
            continue  # its poses would be taken for jumps
        accepted += 1
        flown = Batch(flights, lambda params: Compiled(params, module)).fly()
        assert not [each.violations for each in flown if each.violations], given
        most = max(each.worst_excursion for each in flown)
        if most > worst:
            worst, farthest = most, given
    return worst, farthest, accepted


def test_random_bodies_and_gains_fly_inside_or_are_refused():
    worst, body, accepted = fuzzed(1, 60)
    assert accepted > 10
    assert worst < MOST, body


@pytest.mark.prove
@pytest.mark.timeout(1800)
def test_a_thousand_random_bodies_fly_inside_or_are_refused(proofs: Proofs):
    # Not always the same bodies: each run of the proof looks elsewhere.
    seed = int(time.time())
    worst, body, accepted = fuzzed(seed, 1000)
    proofs.add(
        "random sets of one to four gains, limits and body parameters, 64 flights each: worst"
        " excursion",
        f"{1000 * worst:.3g} mm, {accepted} sets flown, {1000 - accepted} refused or left out"
        f" (seed {seed})",
        "10 mm",
    )
    assert worst < MOST, body
