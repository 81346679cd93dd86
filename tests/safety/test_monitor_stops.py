"""The monitor and what stops a flight: a hold, lost poses, a new boot, the cage."""

from collections.abc import Callable

import pytest

from quadctl.schemas.messages import CageSize, Position, Velocity
from tests.safety.rig import GROUND, INSIDE, ONE_UP, OTHER, OUTSIDE, Rig


def test_a_hold_brakes_and_then_settles_where_it_came_to_rest():
    rig = Rig().moving()
    rig.at(Position(1.0, 0.0, 1.0), Velocity(3.0, 0.0, 0.0))
    rig.monitor.hold()
    assert (rig.state.state, rig.state.reason) == ("HOVERING", "hold: stopped on request")
    assert rig.monitor.setpoint().brake
    assert rig.at(Position(2.0, 0.0, 1.0), Velocity(1.0, 0.0, 0.0)).goal.x == 1.0
    assert rig.at(Position(2.2, 0.0, 1.0)).goal.x == 2.2
    # It holds that place: a later drift does not move the goal along.
    assert rig.at(Position(2.3, 0.0, 1.0)).goal.x == 2.2
    assert rig.monitor.ask(OTHER) == ""


def test_lost_poses_pause_the_flight_and_nothing_is_taken_until_they_are_back():
    rig = Rig().moving()
    rig.monitor.lose()
    assert (rig.state.state, rig.state.reason) == ("HOVERING", "paused: no pose for 0.2 s")
    assert rig.monitor.setpoint().brake
    told = len(rig.told)
    rig.monitor.lose()
    rig.monitor.silent(0.9)
    assert len(rig.told) == told
    refused = "paused: no pose: dynamics is silent; no goal is taken meanwhile"
    assert rig.monitor.ask(OTHER) == refused
    assert rig.at(ONE_UP).state == "MOVING"
    assert rig.state.reason.startswith("went on after a pause: no pose")
    assert (rig.monitor.setpoint().position, rig.monitor.setpoint().brake) == (INSIDE, False)


def test_beyond_the_grace_the_flight_is_over_also_where_a_pose_comes_then():
    rig = Rig().moving()
    rig.monitor.lose()
    rig.monitor.silent(1.1, own=0.9)
    assert (rig.state.state, rig.state.reason) == ("HOVERING", "no pose for 1 s: stopped")
    assert rig.at(ONE_UP).state == "HOVERING"
    assert rig.monitor.setpoint().brake
    assert rig.monitor.ask(INSIDE) == ""


def test_poses_that_may_be_older_than_the_grace_are_no_silence():
    rig = Rig(pose_timeout=2.0).moving()
    rig.monitor.silent(1.5)
    assert rig.state.state == "MOVING"
    rig.monitor.silent(2.1)
    assert rig.state.reason == "no pose for 2 s: stopped"


@pytest.mark.parametrize("what", ["toggle", "resize", "hold", "boot"])
def test_what_happens_in_a_pause_ends_the_flight(what: str):
    rig = Rig().moving()
    rig.monitor.lose()
    match what:
        case "toggle":
            rig.monitor.toggle(cage_on=True)
        case "resize":
            rig.monitor.resize()
        case "hold":
            rig.monitor.hold()
    state = rig.at(ONE_UP, boot="b2" if what == "boot" else "b1")
    assert state.state == "HOVERING"
    assert state.reason
    assert rig.monitor.setpoint().brake


def test_a_vehicle_that_lagged_flies_on_within_the_grace_alone():
    rig = Rig().moving()
    rig.monitor.lagged("the vehicle heard nothing for 0.4 s", 0.4)
    assert rig.state.state == "MOVING"
    assert rig.state.reason == "went on after a pause: the vehicle heard nothing for 0.4 s"
    rig.monitor.lagged("the vehicle heard nothing for 1.4 s", 1.4)
    assert (rig.state.state, rig.monitor.setpoint().brake) == ("HOVERING", True)


def test_losing_poses_while_hovering_changes_nothing_but_blinds():
    rig = Rig().hovering()
    before = rig.state
    rig.monitor.lose()
    assert rig.state == before
    assert rig.monitor.ask(INSIDE) == "no pose: dynamics is silent"


def test_an_old_or_reordered_pose_is_ignored():
    rig = Rig().moving()
    now = rig.monitor.pose
    rig.monitor.see(rig.pose(now.stamp - 0.01, INSIDE))
    assert rig.monitor.pose is now
    assert rig.state.state == "MOVING"
    rig.monitor.lose()
    rig.monitor.see(rig.pose(now.stamp - 0.01, ONE_UP))
    assert not rig.monitor.fresh


def test_a_new_boot_drops_the_goal_says_so_and_takes_off_anew():
    rig = Rig().moving()
    rig.monitor.see(rig.pose(0.0, Position(0.0, 0.0, 0.5), boot="b2"))
    state = rig.state
    assert (state.boot, state.state, state.goal.z) == ("b2", "HOVERING", 0.5)
    assert state.reason == "the simulation started anew: the goal is dropped"
    assert rig.monitor.setpoint().brake
    rig.monitor.see(rig.pose(0.0, GROUND, boot="b3"))
    assert (rig.state.boot, rig.state.state, rig.state.goal) == ("b3", "MOVING", ONE_UP)
    assert any(told.reason.startswith("the simulation started anew") for told, _ in rig.told)


@pytest.mark.parametrize("z", [0.0, 1.0])
def test_restarted_it_hovers_where_the_vehicle_is_with_the_cage_on(z: float):
    rig = Rig(restarted=True, cage_on=False)
    assert rig.state.cage_on
    here = Position(7.0, 0.0, z)
    state = rig.at(here)
    assert (state.state, state.goal, state.cage_on) == ("HOVERING", here, True)
    assert state.reason == "safety restarted: hovering here, cage on"
    assert rig.monitor.setpoint().brake
    # From outside it may fly back in; a boot after this one is like any other.
    assert rig.monitor.ask(INSIDE) == ""
    assert rig.at(GROUND, boot="b2").goal == ONE_UP


def turn_on(rig: Rig) -> None:
    rig.monitor.toggle(cage_on=True)


def shrink(rig: Rig) -> None:
    rig.monitor.toggle(cage_on=True)
    rig.params.virtual_cage.x = 2.0
    rig.monitor.resize()


@pytest.mark.parametrize(("change", "goal"), [(turn_on, OUTSIDE), (shrink, INSIDE)])
def test_a_cage_that_shuts_the_goal_out_under_way_stops(
    change: Callable[[Rig], None], goal: Position
):
    rig = Rig(cage_on=False).hovering()
    assert rig.monitor.ask(goal) == ""
    rig.at(Position(1.0, 0.0, 1.0), Velocity(3.0, 0.0, 0.0))
    change(rig)
    state = rig.state
    assert (state.state, state.cage_on, state.goal.x) == ("HOVERING", True, 1.0)
    assert state.reason.startswith("stopped, the goal is now outside the cage: x = ")
    assert rig.monitor.setpoint().brake


def test_a_cage_that_still_holds_the_goal_lets_the_flight_go_on():
    rig = Rig(cage_on=False).moving()
    rig.monitor.toggle(cage_on=True)
    rig.params.virtual_cage.x = 3.0
    rig.monitor.resize()
    assert (rig.state.state, rig.state.goal) == ("MOVING", INSIDE)
    assert rig.state.cage == CageSize(3.0, 5.0, 2.0)
    assert rig.told[-1][0].cage == CageSize(3.0, 5.0, 2.0)
