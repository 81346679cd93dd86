"""Where `fleet goto` sends whom, and which of several failures its exit code is."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cli.fleet.formation import about, named_goals, point
from cli.fleet.land import ground_below
from cli.fleet.told import fail
from schemas.geometry import Position
from schemas.messages import CageSize, SafetyState
from services.runtime.errors import (
    Invalid,
    QuadctlError,
    Refused,
    TimedOut,
    Unreachable,
    UsageError,
)

NAMES = ["uav0", "uav1"]
LINE = {"line": {"uav0": Position(-1.0, 0.0, 0.0), "uav1": Position(1.0, 0.0, 0.5)}}
metres = st.floats(-1000, 1000)
points = st.builds(Position, metres, metres, metres)


def test_by_name_by_formation_and_by_the_centre():
    assert named_goals(["uav1=1,-2,.5"], NAMES, {}) == {"uav1": Position(1.0, -2.0, 0.5)}
    assert named_goals(["line"], NAMES, LINE) == LINE["line"]
    assert named_goals(["line", "0", "1", "2"], NAMES, LINE) == {
        "uav0": Position(-1.0, 1.0, 2.0),
        "uav1": Position(1.0, 1.0, 2.5),
    }
    assert named_goals(["1", "2", "1"], NAMES, LINE) is None
    assert point(["1", "-2", "1"]) == Position(1.0, -2.0, 1.0)


@given(st.lists(points, min_size=1, max_size=5), points)
def test_all_keep_their_formation_about_the_new_centre(places: list[Position], to: Position):
    before = {f"uav{i}": place for i, place in enumerate(places)}
    after = about(before, to)
    for axis in "xyz":
        offsets = [getattr(after[n], axis) - getattr(before[n], axis) for n in before]
        assert max(offsets) - min(offsets) < 1e-9
        mean = sum(getattr(p, axis) for p in after.values()) / len(after)
        assert mean == pytest.approx(getattr(to, axis), abs=1e-9)


@given(points, points)
def test_one_vehicle_goes_just_there_to_the_bit(place: Position, to: Position):
    assert about({"uav": place}, to) == {"uav": to}


@pytest.mark.parametrize("words", [["line", "1"], ["uav0=1,2"], ["uav0=1,2,x"],
                                   ["line", "uav0=1,2,1"]])  # fmt: skip
def test_what_is_no_place_is_a_matter_of_usage(words: list[str]):
    with pytest.raises(UsageError):
        named_goals(words, NAMES, LINE)


@pytest.mark.parametrize("words", [["1", "2"], ["1", "2", "x"], ["1", "2", "3", "4"]])
def test_neither_is_a_centre(words: list[str]):
    assert named_goals(words, NAMES, LINE) is None
    with pytest.raises(UsageError):
        point(words)


@pytest.mark.parametrize(
    ("words", "hint"), [(["lin"], "line?"), (["uav7=0,0,1"], "uav"), (["x=0,0,1"], "uav0, uav1")]
)
def test_a_name_that_is_not_there_is_told_with_the_nearest(words: list[str], hint: str):
    with pytest.raises(Invalid) as raised:
        named_goals(words, NAMES, LINE)
    assert hint in raised.value.hint


@pytest.mark.parametrize(
    ("problems", "code"),
    [
        ([Refused("no")], 5),
        ([Unreachable("gone"), Refused("no"), TimedOut("late")], 3),
        ([TimedOut("late"), Refused("no"), Invalid("what")], 4),
        ([Unreachable("gone"), QuadctlError("?")], 1),
    ],
)
def test_the_exit_code_is_that_of_the_worst(problems: list[QuadctlError], code: int):
    with pytest.raises(QuadctlError) as raised:
        fail({f"uav{number}": problem for number, problem in enumerate(problems)})
    assert raised.value.exit_code == code
    said = [raised.value.message, *raised.value.others]
    assert sorted(one.partition(":")[0] for one in said) == [
        f"uav{n}" for n in range(len(problems))
    ]


def test_where_none_failed_nothing_is_raised():
    fail({})


@pytest.mark.parametrize(
    ("at", "cage_on", "x"),
    [(3.0, True, 3.0), (8.0, True, 5.0), (-8.0, True, -5.0), (8.0, False, 8.0)],
)
def test_the_ground_below_lies_in_the_cage(at: float, cage_on: bool, x: float):
    state = SafetyState(
        "b", 0.0, 0, "HOVERING", Position(0.0, 0.0, 1.0), cage_on, CageSize(5.0, 5.0, 2.0), ""
    )
    assert ground_below(Position(at, 1.0, 2.0), state) == Position(x, 1.0, 0.0)
