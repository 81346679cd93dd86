"""Goals of `fleet goto`, and the exit code after several failures."""

import pytest
from hypothesis import given, strategies as st

from quadctl.cli.fleet.file import FleetFile, Member
from quadctl.cli.fleet.goto import about, named_goals, read
from quadctl.cli.fleet.hubs import fail, no_vehicle_sent
from quadctl.cli.fleet.land import ground_below
from quadctl.schemas.messages import CageSize, Position, SafetyState
from quadctl.services.runtime.errors import (
    Invalid,
    QuadctlError,
    Refused,
    TimedOut,
    Unreachable,
    UsageError,
)

LINE = {"line": {"uav0": Position(-1.0, 0.0, 0.0), "uav1": Position(1.0, 0.0, 0.5)}}
MEMBERS = [Member("uav0", "", "uav0"), Member("uav1", "", "uav1")]
FLEET = FleetFile(MEMBERS, LINE, "f.toml")
metres = st.floats(-1000, 1000)
points = st.builds(Position, metres, metres, metres)


def test_goals_are_given_by_name_by_formation_or_by_centre():
    assert named_goals(read(["uav1=1,-2,.5"]), FLEET) == {"uav1": Position(1.0, -2.0, 0.5)}
    assert named_goals(read(["line"]), FLEET) == LINE["line"]
    assert named_goals(read(["line", "0", "1", "2"]), FLEET) == {
        "uav0": Position(-1.0, 1.0, 2.0),
        "uav1": Position(1.0, 1.0, 2.5),
    }
    assert named_goals(read(["1", "2", "1"]), FLEET) is None
    assert read(["1", "-2", "1"]).at == Position(1.0, -2.0, 1.0)


@given(st.lists(points, min_size=1, max_size=5), points)
def test_the_formation_is_kept_around_the_new_centre(places: list[Position], to: Position):
    before = {f"uav{i}": place for i, place in enumerate(places)}
    after = about(before, to)
    for axis in "xyz":
        offsets = [getattr(after[n], axis) - getattr(before[n], axis) for n in before]
        assert max(offsets) - min(offsets) < 1e-9
        mean = sum(getattr(p, axis) for p in after.values()) / len(after)
        assert mean == pytest.approx(getattr(to, axis), abs=1e-9)


@given(points, points)
def test_a_single_vehicle_gets_exactly_the_centre(place: Position, to: Position):
    assert about({"uav": place}, to) == {"uav": to}


@pytest.mark.parametrize(
    "words",
    [["line", "1"], ["uav0=1,2"], ["uav0=1,2,x"], ["line", "uav0=1,2,1"], ["uav0=1,2,1", "line"],
     ["1", "2"], ["1", "2", "x"], ["1", "2", "3", "4"], ["uav0=1,2,1", "uav0=-1,-2,1"]],
)  # fmt: skip
def test_words_that_are_no_goal_are_a_usage_error(words: list[str]):
    with pytest.raises(UsageError):
        read(words)


@pytest.mark.parametrize(
    ("words", "coordinate"),
    [("nan 0 1", "x = nan"), ("0 1e400 1", "y = inf"), ("line 0 0 -inf", "z = -inf"),
     ("uav0=20000,0,1", "x = 20000")],
)  # fmt: skip
def test_an_invalid_coordinate_is_quoted_as_typed(words: str, coordinate: str):
    with pytest.raises(Invalid) as raised:
        read(words.split())
    assert f"{coordinate} is not a valid coordinate" in raised.value.message


@pytest.mark.parametrize(
    ("words", "hint"),
    [(["lin"], "line?"), (["circle"], "f.toml has line"), (["uav7=0,0,1"], "uav"),
     (["x=0,0,1"], "uav0, uav1")],
)  # fmt: skip
def test_an_unknown_name_gets_the_nearest_as_a_hint(words: list[str], hint: str):
    with pytest.raises(Invalid) as raised:
        named_goals(read(words), FLEET)
    assert hint in raised.value.hint


@pytest.mark.parametrize("source", ["", "f.toml"])
def test_missing_formation_names_the_file_and_the_table(source: str):
    with pytest.raises(Invalid) as raised:
        named_goals(read(["circle"]), FleetFile(MEMBERS, {}, source))
    assert f"in {source or 'fleet.toml'}: [formations.circle]" in raised.value.hint
    assert "uav0 = [" in raised.value.hint


def test_an_incomplete_formation_sends_no_vehicle():
    problems = {"red": Refused("not ready"), "uav0": Unreachable("gone", "start it")}
    error = no_vehicle_sent(problems, ["uav0", "uav1", "red"])
    assert error.exit_code == 3
    assert error.message == (
        "no vehicle was sent: the formation's centre needs all; red: not ready; uav0: gone"
    )
    assert "fleet goto uav1=1,2,1" in error.hint
    assert no_vehicle_sent(problems, ["uav0", "red"]).hint == "start it"


@pytest.mark.parametrize(
    ("problems", "code"),
    [
        ([Refused("no")], 5),
        ([Unreachable("gone"), Refused("no"), TimedOut("late")], 3),
        ([TimedOut("late"), Refused("no"), Invalid("what")], 4),
        ([Unreachable("gone"), QuadctlError("?")], 1),
    ],
)
def test_the_exit_code_is_that_of_the_worst_failure(problems: list[QuadctlError], code: int):
    with pytest.raises(QuadctlError) as raised:
        fail({f"uav{number}": problem for number, problem in enumerate(problems)})
    assert raised.value.exit_code == code
    messages = [raised.value.message, *raised.value.others]
    assert sorted(one.partition(":")[0] for one in messages) == [
        f"uav{n}" for n in range(len(problems))
    ]


def test_without_failures_nothing_is_raised():
    fail({})


@pytest.mark.parametrize(
    ("at", "cage_on", "x"),
    [(3.0, True, 3.0), (8.0, True, 5.0), (-8.0, True, -5.0), (8.0, False, 8.0)],
)
def test_the_landing_point_is_inside_the_cage(at: float, cage_on: bool, x: float):
    state = SafetyState(
        "b", 0.0, 0, "HOVERING", Position(0.0, 0.0, 1.0), cage_on, CageSize(5.0, 5.0, 2.0), ""
    )
    assert ground_below(Position(at, 1.0, 2.0), state) == Position(x, 1.0, 0.0)
