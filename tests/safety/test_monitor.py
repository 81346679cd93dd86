"""The monitor and its requests: the take-off, refusals, replacing, counting."""

from math import inf, nan

import pytest
from msgspec.structs import replace

from quadctl.schemas.messages import Position
from quadctl.services.safety.model import State
from tests.safety.rig import BEYOND, GROUND, INSIDE, ONE_UP, OTHER, OUTSIDE, Rig


def test_before_a_pose_nothing_is_taken():
    rig = Rig()
    assert rig.monitor.ask(INSIDE) == "no pose: dynamics is silent"
    assert (rig.state.state, rig.state.request, rig.state.boot) == ("HOVERING", 1, "")
    assert rig.monitor.setpoint().brake


def test_the_take_off_is_verified_and_flown():
    rig = Rig()
    state = rig.at(GROUND)
    assert (state.state, state.goal, state.request, state.boot) == ("MOVING", ONE_UP, 1, "b1")
    assert rig.monitor.setpoint() == replace(
        rig.monitor.setpoint(), boot="b1", for_seq=1, position=ONE_UP, brake=False
    )
    assert [told.state for told, _ in rig.told] == ["HOVERING", "VERIFYING", "MOVING"]


@pytest.mark.parametrize(
    ("start", "height", "reason"),
    [
        (Position(9.0, 0.0, 0.0), 1.0, BEYOND),
        (GROUND, 3.0, "outside the cage: z = 3 is beyond [0, 2]"),
    ],
)
def test_a_take_off_out_of_the_cage_stays_on_the_ground_and_says_why(
    start: Position, height: float, reason: str
):
    rig = Rig(takeoff=height)
    state = rig.at(start)
    assert (state.state, state.reason, state.goal) == ("HOVERING", reason, start)
    assert rig.monitor.setpoint().brake
    assert rig.at(start).state == "HOVERING"


def test_with_the_cage_off_the_take_off_is_not_refused():
    assert Rig(cage_on=False).at(Position(9.0, 0.0, 0.0)).state == "MOVING"


@pytest.mark.parametrize(("takeoff", "z"), [(0.0, 0.0), (1.0, 0.05), (1.0, 1.5)])
def test_no_take_off_when_none_is_wanted_or_it_flies_already(takeoff: float, z: float):
    start = Position(1.0, 1.0, z)
    state = Rig(takeoff=takeoff).at(start)
    assert (state.state, state.goal, state.request) == ("HOVERING", start, 0)


def test_the_take_off_gives_way_to_the_first_request_and_that_one_does_not():
    rig = Rig()
    rig.at(GROUND)
    assert rig.monitor.ask(INSIDE) == ""
    assert rig.state.goal == INSIDE
    assert rig.monitor.ask(OTHER).startswith("busy: flying to (3, 0, 1)")


def test_a_refused_request_leaves_the_take_off_going_and_able_to_give_way():
    rig = Rig()
    rig.at(GROUND)
    assert rig.monitor.ask(OUTSIDE) == BEYOND
    assert (rig.state.state, rig.state.goal) == ("MOVING", ONE_UP)
    assert rig.monitor.ask(INSIDE) == ""


def test_arriving_within_the_range_makes_it_ready_again():
    rig = Rig().moving()
    assert rig.at(Position(2.5, 0.0, 1.0)).state == "MOVING"
    state = rig.at(Position(2.501, 0.0, 1.0))
    assert (state.state, state.goal, state.reason) == ("HOVERING", INSIDE, "")
    assert not rig.monitor.setpoint().brake
    assert rig.monitor.ask(OTHER) == ""


def test_outside_is_refused_and_the_vehicle_stays():
    rig = Rig().hovering()
    before = rig.monitor.setpoint()
    assert rig.monitor.ask(OUTSIDE) == BEYOND
    assert rig.monitor.setpoint() == before
    assert (rig.state.state, rig.state.reason) == ("HOVERING", BEYOND)


@pytest.mark.parametrize("cage_on", [True, False])
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_no_place_is_refused_even_with_the_cage_off(cage_on: bool, value: float):
    rig = Rig(cage_on=cage_on).hovering()
    before = rig.monitor.setpoint()
    for axis in "xyz":
        assert f"{axis} = {value}" in rig.monitor.ask(replace(INSIDE, **{axis: value}))
    assert rig.monitor.setpoint() == before
    assert rig.state.state == "HOVERING"


def test_busy_until_replaced_and_a_refused_replacement_keeps_the_flight():
    rig = Rig().moving()
    assert rig.monitor.ask(OTHER).startswith("busy: flying to (3, 0, 1)")
    assert rig.monitor.ask(OUTSIDE, replace=True) == BEYOND
    assert (rig.state.state, rig.state.goal, rig.state.reason) == ("MOVING", INSIDE, BEYOND)
    assert not rig.monitor.setpoint().brake
    assert rig.monitor.ask(OTHER, replace=True) == ""
    assert (rig.state.state, rig.state.goal, rig.state.reason) == ("MOVING", OTHER, "")


def test_every_request_counts_so_that_equal_refusals_differ():
    rig = Rig().hovering()
    counts = []
    for ask in (OUTSIDE, OUTSIDE, INSIDE, OTHER, OTHER):
        rig.monitor.ask(ask)
        counts.append(rig.state.request)
    assert counts == [2, 3, 4, 5, 6]
    assert [told.request for told, _ in rig.told if told.reason == BEYOND] == [2, 3]


def test_the_log_line_says_what_was_asked_and_where_it_led():
    rig = Rig().hovering()
    rig.told.clear()
    rig.monitor.ask(Position(3.0, 0.5, 1.0))
    rig.monitor.ask(OTHER)
    rig.monitor.toggle(cage_on=False)
    assert [line for _, line in rig.told] == [
        "Requested position: (3, 0.5, 1). Current State: VERIFYING",
        "Current State: MOVING",
        "Requested position: (0, 3, 1). busy: flying to (3, 0.5, 1); ask with replace to change course",
        "Cage: off",
    ]
    assert rig.monitor.situation.state is State.MOVING
