"""Bodies and gains from anywhere in the table of what may fly, and a search for their worst flights."""

from math import inf
from random import Random
from typing import Any

import numpy as np
from msgspec import to_builtins
from msgspec.inspect import FloatType

from quadctl.schemas.params import DynamicsParams
from quadctl.services.airspace import airworthiness
from quadctl.services.campaign import search as genomes
from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.mission import Conditions, Mission, Param, with_given
from quadctl.services.campaign.vehicles import Compiled
from quadctl.services.runtime.params import catalogue
from quadctl.services.runtime.params.names import flatten
from tests.support.compiled import compiled_kernel
from tests.support.evolved import Genes, evolve_together

_DRAG = ("drag", "linear_drag", "across", "along")
_LIMITS = {"max_tilt": -3, "max_speed": -5, "max_acceleration": -4, "max_jerk": -3}
"""Limits, each with the power of two of its least share: of jerk none is accepted with less, with less of the
others flights take minutes."""
_CAGES = ((0.2, 0.2, 0.2), *genomes.CAGES, (20.0, 20.0, 20.0))
_SECONDS = 14.0
_PARAMETERS = catalogue.leaves()
_TOGETHER = 250
"""Flights of a batch: each is faster in larger ones."""
Given = dict[str, Any]


def random_body(draws: Random, *, soft: bool = False) -> Given:
    """Return the parameters of a vehicle that is accepted; a soft one has low limits, too."""
    while True:
        given = _drawn(draws, soft)
        flies = dynamics_of(given)
        body = flies.vehicle, flies.control
        assert not airworthiness.why_unproven(*body), given
        if not airworthiness.why_not(*body, flies.wind):
            return given


def dynamics_of(given: Given) -> DynamicsParams:
    """Return the parameters of dynamics with the given ones."""
    return with_given(DynamicsParams(), "dynamics", given)


def _drawn(draws: Random, soft: bool) -> Given:
    body = draws.choice(airworthiness.BODIES)
    vehicle = {
        f"dynamics.vehicle.{name}": value for name, value in flatten(to_builtins(body.vehicle))
    }
    control = {
        f"dynamics.control.{name}": value for name, value in flatten(to_builtins(body.control))
    }
    few, at_edge = draws.random() < 0.5, draws.random() < 0.4
    for table, most in ((vehicle, 2.0), (control, 1.5)):
        for name, value in table.items():
            if name.rpartition(".")[2] in _LIMITS or (few and draws.random() < 0.7):
                continue
            power = float(draws.choice((-1, 0, 1))) if at_edge else draws.uniform(-1, 1)
            table[name] = value * most ** (power * (1 - 1e-9))
    given = vehicle | control
    for name in given:
        last = name.rpartition(".")[2]
        if last in _LIMITS:
            if soft or draws.random() < 0.5:
                value = control[name] * 2 ** draws.uniform(_LIMITS[last], -1 if soft else 1)
                bounds = _PARAMETERS[name].type
                assert isinstance(bounds, FloatType)
                given[name] = min(max(value, bounds.ge or 0.0), bounds.le or value)
        elif last in _DRAG and draws.random() < 0.5:
            given[name] = vehicle[name] * draws.uniform(0, 2)
    if draws.random() < 0.3:
        given["dynamics.vehicle.linear_drag"] = (
            draws.uniform(0, 0.5) * given["dynamics.vehicle.mass"]
        )
    return given


def random_flight(draws: Random, *, windy: bool) -> Mission:
    """Return a flight of the search of campaigns, in a random cage, by a random body that may change in flight."""
    given, change = random_body(draws), None
    if draws.random() < 0.3:
        later = random_body(draws)
        name = draws.choice(sorted(later))
        change = Param(0.0, name, later[name])
    if windy:
        axis, speed = draws.choice("xyz"), draws.choice((0.0, draws.uniform(-4, 4)))
        blowing = {f"dynamics.wind.mean.{axis}": speed, "dynamics.wind.gust": draws.uniform(0, 2)}
        blowing["dynamics.seed"] = draws.randrange(2**31)
        flies = dynamics_of(given | blowing)
        if not airworthiness.why_not(flies.vehicle, flies.control, flies.wind):
            given |= blowing
    around = genomes.Surroundings(draws.choice(_CAGES), (0.0, 0.0), 0, change)
    genome = np.array([draws.random() for _ in range(genomes.GENOME)])
    return genomes.decode(genome, around, Conditions(_SECONDS, given=given), 0)


def search(evaluations: int, island: int = 0, *, windy: bool = False) -> tuple[float, str]:
    """Return the greatest excursion of so many flights, in margins in force, and its flight.

    A flight that breaks another promise counts infinitely.
    """
    found: list[tuple[float, str]] = []

    def ranks(genes: list[Genes]) -> list[float]:
        flights = [random_flight(draws, windy=windy) for draws in genes]
        batch = Batch(flights, lambda params: Compiled(params, compiled_kernel()))
        shares = []
        for flight, flown in zip(flights, batch.fly_near(), strict=True):
            others = [what for what in flown.violations if not what.startswith("more than ")]
            shares.append(inf if others else flown.worst_excursion / flight.margin)
            found.append((shares[-1], f"{flown.violations} {flight}"))
        found[:] = [max(found)]
        return [-share for share in shares]

    evolve_together(ranks, evaluations, island, together=min(_TOGETHER, evaluations))
    return found[0]
