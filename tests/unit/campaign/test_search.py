"""Search: genomes are valid missions, and its runs evolve them, the same way for the same seed."""

from math import dist
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from msgspec import to_builtins
from msgspec.structs import replace

from quadctl.cli.mission.mission import mission as read
from quadctl.cli.mission.writer import text
from quadctl.schemas.params import DynamicsParams
from quadctl.services.campaign.mission import Conditions, GotoEvent, Mission, Param
from quadctl.services.campaign.score import Flown, LaunchCage, inside
from quadctl.services.campaign.search import (
    CAGES,
    GENOME,
    POPULATION,
    RUNS,
    Search,
    Surroundings,
    decode,
    tables,
)
from quadctl.services.runtime.params.load import parse
from quadctl.services.runtime.params.names import flatten

NUMBERS = st.lists(st.floats(-3.0, 3.0), min_size=GENOME, max_size=GENOME).map(np.array)
CHANGES = st.sampled_from(
    [None, Param(0.0, "dynamics.control.max_jerk", 0.1), Param(0.0, "dynamics.fault.motors", 0.7)]
)
SURROUNDINGS = st.builds(
    Surroundings,
    st.sampled_from(CAGES),
    st.sampled_from([(0.0, 0.0), (3.0, -1.0)]),
    st.just(7),
    CHANGES,
)
CONDITIONS = st.sampled_from(
    [Conditions(14.0), Conditions(3.0, given={"safety.virtual_cage.z": 0.4, "safety.margin": 0.1})]
)


@pytest.mark.thorough
@settings(max_examples=200, deadline=None)
@given(NUMBERS, SURROUNDINGS, CONDITIONS)
def test_every_genome_is_a_mission_in_its_cage_and_a_valid_file(genome, around, conditions):
    made = decode(genome, around, conditions, 5)
    times = [row.at for row in made.rows]
    assert times == sorted(times)
    assert all(0.0 <= at < conditions.seconds for at in times)
    assert all(20 * at == round(20 * at) for at in times)
    cage = made.safety.virtual_cage
    size = {"x": cage.x, "y": cage.y, "z": cage.z}
    start = made.dynamics.start
    assert inside((start.x, start.y, start.z), tuple(size.values()))
    for row in made.rows:
        if isinstance(row, Param) and row.name.startswith("safety.virtual_cage."):
            assert not conditions.given
            size[row.name[-1]] = row.value
        if isinstance(row, GotoEvent):
            assert inside((row.x, row.y, row.z), tuple(size.values()))
    if made.rows:
        file = read(parse(text(tables(made)), "worst.toml"), "worst.toml")
        assert [row.at for row in file.rows] == times
        assert file.params.safety == made.safety
        assert file.params.dynamics.start == made.dynamics.start
        assert file.params.dynamics.wind == made.dynamics.wind


def flown(mission: Mission) -> Flown:
    """Return a flight that goes farther out the nearer its goals are to one corner."""
    cage = mission.safety.virtual_cage
    corner = (cage.x, -cage.y, cage.z)
    goals = [(row.x, row.y, row.z) for row in mission.rows if isinstance(row, GotoEvent)]
    way = sum(dist(goal, corner) for goal in goals) / max(len(goals), 1)
    far = 1.0 if goals else 9.0
    launch = LaunchCage.of(mission.safety)
    return Flown(
        mission.seed, launch, -far - way, 1.0, {}, {}, {}, {}, (0.0, 0.0), {}, [], [], ""
    )  # fmt: skip


def searched(rounds: int, *, shuffled: bool = False) -> Search:
    search, draws = Search(3, Conditions(14.0)), Random(1)
    for _ in range(rounds):
        flights = [flown(mission) for mission in search.ask()]
        if shuffled:
            draws.shuffle(flights)
        search.tell(flights)
    return search


@pytest.mark.thorough
def test_a_search_finds_worse_flights_than_random_ones():
    first = searched(1)._worst
    evolved = searched(12)
    assert evolved.evaluations == 12 * RUNS * POPULATION
    assert first is not None
    assert evolved._worst is not None
    assert evolved._worst[1] > -1.01 - 0.5 * (-1.01 - first[1])


@pytest.mark.thorough
def test_the_order_of_flights_has_no_effect():
    assert searched(3, shuffled=True).document() == searched(3).document()


def test_a_flight_with_a_violation_is_worse_than_one_farther_out():
    search = Search(0, Conditions(14.0))
    flights = [flown(mission) for mission in search.ask()]
    flights[17] = replace(
        flights[17], worst_excursion=-9.5, violations=["MOVING to a goal outside"]
    )
    assert search.tell(flights)
    assert search.document()["violations"] == ["MOVING to a goal outside"]


@pytest.mark.parametrize("wind", [0.0, 3.0])
def test_wind_is_at_most_the_given_one(wind: float):
    for mission in Search(1, Conditions(14.0, wind=wind)).ask():
        mean = mission.dynamics.wind.mean
        assert np.hypot(mean.x, mean.y) <= wind + 1e-9


def changed(conditions: Conditions) -> set[str]:
    """Return the parameters of dynamics that change in any of many missions."""
    rows = (
        row
        for seed in range(3)
        for mission in Search(seed, conditions).ask()
        for row in mission.rows
    )
    return {row.name for row in rows if isinstance(row, Param) and row.name.startswith("dynamics")}


def test_motors_are_weak_only_on_request():
    assert "dynamics.fault.motors" in changed(Conditions(14.0, faults=True))
    assert "dynamics.fault.motors" not in changed(Conditions(14.0))


def test_given_parameters_do_not_change_in_flight():
    given = {
        name: value
        for name, value in flatten(to_builtins({"dynamics": DynamicsParams()}))
        if name.startswith(("dynamics.control.", "dynamics.vehicle."))
    }
    assert changed(Conditions(14.0))
    assert changed(Conditions(14.0, given=given)) == set()
