"""Random missions: reproducible by their seed, with every kind of event and fault."""

from collections import Counter
from math import isfinite
from random import Random

import pytest

from quadctl.services.campaign.mission import (
    Conditions,
    Deaf,
    Fault,
    GotoEvent,
    Late,
    Mission,
    Param,
    Range,
    Resize,
    Row,
    faults_of,
    mission,
    text,
)
from quadctl.services.campaign.score import inside
from tests.support.campaign_flights import missions

FAULTS = Fault.__args__


@pytest.fixture(scope="module")
def made() -> list[Mission]:
    return missions(range(300), 60.0, faults=True)


def test_the_same_seed_makes_the_same_mission():
    first, second, other = (
        mission(7, Random(seed), Conditions(60.0, faults=True)) for seed in (7, 7, 8)
    )
    assert repr(first) == repr(second)  # by their text: nan is not equal to itself
    assert first.rows != other.rows


def test_given_parameters_replace_random_ones_and_their_changes():
    given = {
        "safety.virtual_cage.x": 0.5,
        "safety.acceptance_range": 0.1,
        "dynamics.vehicle.mass": 2.0,
    }
    for seed in range(30):
        random = mission(seed, Random(seed), Conditions(60.0))
        one = mission(seed, Random(seed), Conditions(60.0, given=given))
        assert (one.safety.virtual_cage.x, one.safety.acceptance_range) == (0.5, 0.1)
        assert one.dynamics.vehicle.mass == 2.0
        assert one.safety.virtual_cage.y == random.safety.virtual_cage.y
        assert not [row for row in one.rows if isinstance(row, Resize | Range)]
        assert [row.at for row in one.rows] == [
            row.at for row in random.rows if not isinstance(row, Resize | Range)
        ]


def test_faults_are_counted_by_kind():
    rows = (Deaf(1.0, 2.0), GotoEvent(1.0, 0.0, 0.0, 1.0, True), Late(2.0, 0.1), Deaf(3.0, 1.0))
    assert faults_of(rows) == {"Deaf": 2, "Late": 1}


def test_rows_are_sorted_by_time_and_within_the_flight(made: list[Mission]):
    for one in made:
        times = [row.at for row in one.rows]
        assert times == sorted(times)
        assert all(0 <= time < 60.0 for time in times)


def test_every_kind_of_row_occurs_and_faults_only_on_request(made: list[Mission]):
    kinds = Counter(type(row) for one in made for row in one.rows)
    assert set(kinds) == set(Row.__args__) - {Param}
    sound = {type(row) for one in missions(range(50), 60.0) for row in one.rows}
    assert sound == set(kinds) - set(FAULTS)


def test_goals_are_inside_on_walls_outside_or_not_finite(made: list[Mission]):
    found = Counter[str]()
    for one in made:
        cage = one.safety.virtual_cage
        size = (cage.x, cage.y, cage.z)
        for row in one.rows:
            if isinstance(row, Resize):
                size = (row.x, row.y, row.z)
            elif isinstance(row, GotoEvent):
                place = (row.x, row.y, row.z)
                walls = (
                    row.x in {-size[0], size[0]},
                    row.y in {-size[1], size[1]},
                    row.z == size[2],
                )
                found["not finite"] += not all(map(isfinite, place))
                found["inside"] += inside(place, size)
                found["on a wall"] += inside(place, size) and any(walls)
                found["outside"] += not inside(place, size)
                x, y, z = place
                near = (0.999999 * x, 0.999999 * y, 0.999999 * z)
                found["just outside"] += not inside(place, size) and inside(near, size)
    assert all(count > 20 for count in found.values()), found


def test_a_row_is_formatted_as_a_command():
    assert (
        text(GotoEvent(1.0, 2.0, -3.5, 0.1234567, True))
        == "goto x=2 y=-3.5 z=0.123457 replace=True"
    )
