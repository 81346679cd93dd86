"""Parameters that change in a simulated flight: the rules of a live system, compiled as in Python."""

from random import Random

import numpy as np
import pytest
from msgspec.structs import replace

from quadctl.schemas.params import DynamicsParams, SafetyParams, StartParams
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import GotoEvent, Mission, Param, Range, Resize, Row
from quadctl.services.campaign.vehicles import Compiled, Plain
from tests.support.campaign_flights import missions
from tests.support.compiled import compiled_kernel

CHANGES = {
    "dynamics.control.max_acceleration": (0.5, 8.0),
    "dynamics.control.position_gain": (0.8, 2.0),
    "dynamics.vehicle.mass": (0.7, 1.5),
    "dynamics.vehicle.mass ": (20.0, 40.0),
    "dynamics.wind.mean.x": (-3.0, 3.0),
    "dynamics.fault.motors": (0.8, 1.0),
    "safety.virtual_cage.x": (0.2, 6.0),
    "safety.acceptance_range": (0.05, 1.0),
}
"""Parameters and their random values; nothing lifts the second mass, so it is refused."""


def changing(seed: int) -> Mission:
    """Return a random mission with four changes of parameters."""
    (random,), draws = missions([seed], 12.0), Random(seed)
    changes = [
        Param(draws.uniform(0.0, 10.0), name.strip(), draws.uniform(*CHANGES[name]))
        for name in draws.sample(sorted(CHANGES), 4)
    ]
    return replace(random, rows=tuple(sorted([*random.rows, *changes], key=lambda row: row.at)))


@pytest.mark.thorough
def test_flights_with_changes_are_the_same_compiled_and_in_python():
    module = compiled_kernel()
    some = [changing(seed) if seed % 3 else missions([seed], 12.0)[0] for seed in range(18)]
    compiled = Batch(some, lambda params: Compiled(params, module))
    assert compiled.fly() == Batch(some, Plain).fly()
    assert any(compiled._fleet.in_force(n) != each.dynamics for n, each in enumerate(some))


def path(*rows: Row) -> tuple[str, np.ndarray]:
    """Return the hash and the path of a flight with goals at 1 s and 7 s, and these rows."""
    goals = (GotoEvent(1.0, 3.0, 0.0, 1.0, False), GotoEvent(7.0, -2.0, 1.0, 2.0, False))
    ordered = tuple(sorted([*goals, *rows], key=lambda row: row.at))
    still = DynamicsParams(start=StartParams(z=1.0))
    random = missions([1], 10.0)[0]
    flight = Batch([replace(random, safety=SafetyParams(), dynamics=still, rows=ordered)], Plain)
    (flown,) = flight.fly()
    return flown.hash, flight._track[:, :3, 0]


@pytest.mark.parametrize("name", ["dynamics.control.max_speed", "dynamics.vehicle.mass"])
def test_body_and_limits_wait_for_the_next_standstill(name: str):
    usual, changed = path()[1], path(Param(1.5, name, 0.9))[1]
    assert np.array_equal(usual[:70], changed[:70])
    assert not np.array_equal(usual[141:], changed[141:])


def test_wind_counts_at_once():
    usual, changed = path()[1], path(Param(1.5, "dynamics.wind.mean.y", 2.0))[1]
    assert np.array_equal(usual[:31], changed[:31])
    assert not np.array_equal(usual[32], changed[32])


@pytest.mark.parametrize(
    ("name", "value"), [("dynamics.vehicle.mass", 40.0), ("safety.takeoff", -1.0)]
)
def test_a_refused_change_has_no_effect(name: str, value: float):
    assert path(Param(1.5, name, value))[0] == path()[0]


@pytest.mark.thorough
def test_a_changed_cage_or_range_is_the_same_as_by_its_own_row():
    size = SafetyParams().virtual_cage
    for change, same in (
        (Param(1.5, "safety.virtual_cage.x", 0.7), Resize(1.5, 0.7, size.y, size.z)),
        (Param(1.5, "safety.acceptance_range", 0.1), Range(1.5, 0.1)),
    ):
        assert path(change)[0] == path(same)[0] != path()[0]
