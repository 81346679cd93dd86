"""Parameters of many vehicles: common and own values, seeds, and starting places."""

import math
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.params import Params
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.params import load


def test_one_vehicle_has_the_values_of_the_file(tmp_path: Path):
    file = tmp_path / "lab.toml"
    file.write_text("[safety]\ntakeoff = 3.0\n[dynamics]\nseed = 5\nstart = { x = 1.0 }")
    loaded = load.load_vehicles(file)["uav"]
    assert (loaded.safety.takeoff, loaded.dynamics.seed, loaded.dynamics.start.x) == (3.0, 5, 1.0)
    assert load.load_vehicles(None) == {"uav": Params()}


def test_names_count_from_zero():
    assert load.names("uav", 3) == ["uav0", "uav1", "uav2"]
    for count in (0, -1, 1001):
        with pytest.raises(UsageError, match="not a number of vehicles"):
            load.names("uav", count)


@pytest.mark.thorough
@given(st.integers(1, 60))
def test_vehicles_start_two_metres_apart_around_the_start(count: int):
    starts = [
        (params.dynamics.start.x, params.dynamics.start.y)
        for params in load.load_vehicles(
            None, ["dynamics.start.x=7", "dynamics.seed=3"], load.names("uav", count)
        ).values()
    ]
    assert len(set(starts)) == count
    apart = [math.dist(a, b) for a, b in combinations(starts, 2)]
    assert min(apart, default=2.0) == 2.0
    side = 2 * (math.ceil(math.sqrt(count)) - 1)
    assert all(abs(x - 7) <= side / 2 and abs(y) <= side / 2 for x, y in starts)


def test_vehicles_start_farther_apart_than_they_have_to_keep():
    wide = load.load_vehicles(None, ["safety.separation.radius=1.5"], ["uav0", "uav1"])
    first, second = (params.dynamics.start for params in wide.values())
    assert second.x - first.x > 3.0


def test_common_values_that_no_vehicle_flies_with_are_not_judged():
    slow = [f"uav{n}.dynamics.control.max_speed=1" for n in range(2)]
    fleet = load.load_vehicles(None, ["safety.max_speed=3", *slow], ["uav0", "uav1"])
    assert {params.safety.max_speed for params in fleet.values()} == {3.0}
    with pytest.raises(Invalid, match=r"safety\.max_speed: 3 m/s is less than"):
        load.load_vehicles(None, ["safety.max_speed=3", slow[0]], ["uav0", "uav1"])


def test_each_vehicle_has_its_own_seed():
    seeds = [
        p.dynamics.seed for p in load.load_vehicles(None, ["dynamics.seed=8"], ["a", "b"]).values()
    ]
    assert seeds == [8, 9]


def test_a_vehicle_can_have_its_own_parameters(tmp_path: Path):
    file = tmp_path / "lab.toml"
    file.write_text(
        "[safety]\ntakeoff = 1.5\n[uav1.safety]\ntakeoff = 2.5\n[uav1.dynamics]\nseed = 7"
    )
    first, second = load.load_vehicles(
        file, ["uav0.safety.virtual_cage.x=9", "uav1.dynamics.start.x=-4"], ["uav0", "uav1"]
    ).values()
    assert (first.safety.takeoff, second.safety.takeoff) == (1.5, 2.5)
    assert (first.safety.virtual_cage.x, second.safety.virtual_cage.x) == (9.0, 5.0)
    assert (first.dynamics.start.x, second.dynamics.start.x) == (-1.0, -4.0)
    assert (first.dynamics.seed, second.dynamics.seed) == (0, 7)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("uav2.safety.takeoff=1", "unknown parameter uav2"),
        ("uav0.safety.takeof=1", "unknown parameter safety.takeof"),
        ("uav0.safety.takeoff=-1", "safety.takeoff: expected `float` >= 0"),
        ("uav0=1", "uav0 is a vehicle, and not a parameter"),
        ("uav0.hub.transport=tcp", "uav0.hub: all vehicles share one"),
        ("uav0.dynamics.speed=2", "uav0.dynamics.speed: all vehicles share one"),
        ("safety.takeof=1", "unknown parameter safety.takeof"),
    ],
)
def test_a_wrong_setting_is_reported(setting: str, message: str):
    with pytest.raises(Invalid) as caught:
        load.load_vehicles(None, [setting], ["uav0", "uav1"])
    assert message in caught.value.message
    assert caught.value.hint


def test_an_unknown_vehicle_is_reported_with_the_known_ones():
    with pytest.raises(Invalid) as caught:
        load.load_vehicles(None, ["uav20.safety.takeoff=1"], load.names("uav", 20))
    assert "the vehicles are uav0 .. uav19 (20)" in caught.value.hint
    with pytest.raises(Invalid) as caught:
        load.load_vehicles(None, ["uav1.safety.takeoff=1"])
    assert caught.value.hint == "the only vehicle is uav: `quadctl up --vehicles N` has more"


def test_a_vehicles_own_table_extends_the_common_ones():
    table = {"safety": {"takeoff": 1.0}, "a": {"safety": {"cage_on": False}}, "b": {"hub": {}}}
    merged = load.table_of(table, "a", ["a", "b"])
    assert merged == {"safety": {"takeoff": 1.0, "cage_on": False}}
