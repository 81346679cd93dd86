"""Statistics of a campaign: its bound, its bins, and its rules by disturbance."""

import json

import pytest

from quadctl.services.campaign.batch import Batch
from quadctl.services.campaign.breakdown import Breakdown, out_of_reach, upper_bound
from quadctl.services.campaign.vehicles import Compiled
from quadctl.services.runtime.errors import Invalid
from quadctl.services.safety.automaton import RULES
from tests.support.campaign_flights import missions
from tests.support.compiled import compiled_kernel

STRAYING, HOLD = "MOVING Seen straying", "MOVING Hold always"


def row(
    excursion: float = 0.0, wind: float = 0.0, faults: tuple[str, ...] = (), **guards: int
) -> tuple[float, str, str, str]:
    fired = {HOLD: 1} | guards
    return (
        excursion,
        json.dumps([0.0, wind]),
        json.dumps(dict.fromkeys(faults, 1)),
        json.dumps(fired),
    )


@pytest.mark.parametrize("flights", [1, 20, 1000, 1_000_000])
def test_the_bound_without_violations_has_a_closed_form(flights: int):
    assert upper_bound(0, flights) == pytest.approx(1 - 0.05 ** (1 / flights), rel=1e-9)


@pytest.mark.parametrize(
    ("violations", "flights"), [(1, 2), (3, 10), (9, 10), (7, 10_000), (500, 1000), (2, 1_000_000)]
)
def test_the_bound_is_that_of_clopper_and_pearson(violations: int, flights: int):
    from scipy.stats import beta  # takes half a second to import

    expected = beta.ppf(0.95, violations + 1, flights - violations)
    assert upper_bound(violations, flights) == pytest.approx(expected, rel=1e-9)


def test_if_all_flights_violate_nothing_is_ruled_out():
    assert upper_bound(5, 5) == 1.0


@pytest.mark.parametrize(
    ("excursion", "number"),
    [(0.0, 0), (1e-300, 1), (1.1e-6, 1), (1.6e-6, 2), (1.1e-3, 16), (99.0, 40), (1e6, 40)],
)
def test_excursions_have_fixed_bins(excursion: float, number: int):
    bins = Breakdown([row(excursion)]).excursions
    assert len(bins) == 41
    assert [at for at, count in enumerate(bins) if count] == [number]


def test_a_flight_counts_in_each_of_its_disturbances():
    rows = [row(), row(wind=-3.0), row(faults=("Mute", "Deaf")), row(wind=3.0, faults=("Mute",))]
    breakdown = Breakdown(iter(rows))
    assert list(breakdown.fired) == ["all", "none", "wind", "Deaf", "Mute"]
    assert dict(breakdown.flights) == {"all": 4, "none": 1, "wind": 2, "Deaf": 1, "Mute": 2}
    assert {name: fired[HOLD] for name, fired in breakdown.fired.items()} == dict(breakdown.flights)


def test_counts_of_a_rule_add_up():
    breakdown = Breakdown([row(**{STRAYING: 2}), row(**{STRAYING: 3}, faults=("Late",))])
    assert [fired[STRAYING] for fired in breakdown.fired.values()] == [5, 2, 3]


def test_a_database_of_another_automaton_is_refused():
    with pytest.raises(Invalid, match="lacks: FLYING Seen happy"):
        Breakdown([row(**{"FLYING Seen happy": 1})])


def test_a_campaign_without_flights_is_refused():
    with pytest.raises(Invalid, match="no flights"):
        Breakdown([])


@pytest.mark.thorough
def test_flights_fire_all_rules_but_those_out_of_reach():
    module = compiled_kernel()
    some = missions(range(400), 60.0, faults=True)
    flights = Batch(some, lambda params: Compiled(params, module)).fly()
    fired = {name for flight in flights for name in flight.guards}
    assert fired == {str(rule) for rule in RULES if not out_of_reach(rule)}
