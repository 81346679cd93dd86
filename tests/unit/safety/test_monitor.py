"""Safety monitor: takeoff, requests, refusals, pauses, and tracking faults."""

from collections.abc import Callable
from math import inf, nan
from random import Random

import pytest
from msgspec.structs import replace

from quadctl.schemas.messages import CageSize, Pose, Position, SafetyState, Setpoint, Velocity
from quadctl.schemas.params import SafetyParams
from quadctl.services.airspace.geometry import Point
from quadctl.services.airspace.stopping import PATIENCE
from quadctl.services.safety.model import State
from quadctl.services.safety.monitor import STOOD_STILL, Monitor, TrackingMonitor
from quadctl.services.safety.traffic import Traffic
from tests.support.monitor_rig import BEYOND, GROUND, INSIDE, ONE_UP, OTHER, OUTSIDE, Rig
from tests.support.monitored_vehicle import LOOKS, MonitoredVehicle, periods
from tests.support.worlds import POSE


def test_a_hold_brakes_and_keeps_the_place_of_rest():
    rig = Rig().moving()
    rig.at(Position(1.0, 0.0, 1.0), Velocity(3.0, 0.0, 0.0))
    rig.monitor.hold()
    assert (rig.state.state, rig.state.reason) == ("HOVERING", "hold: stopped on request")
    assert rig.monitor.setpoint().brake
    assert rig.at(Position(2.0, 0.0, 1.0), Velocity(1.0, 0.0, 0.0)).goal.x == 1.0
    assert rig.at(Position(2.2, 0.0, 1.0)).goal.x == 2.2
    # The goal is fixed: a later drift does not move it.
    assert rig.at(Position(2.3, 0.0, 1.0)).goal.x == 2.2
    assert rig.monitor.goto(OTHER) == ""


def test_lost_poses_pause_the_flight_and_goals_are_refused():
    rig = Rig().moving()
    rig.monitor.lose()
    assert (rig.state.state, rig.state.reason) == ("HOVERING", "paused: no pose for 0.2 s")
    assert rig.monitor.setpoint().brake
    published = len(rig.published)
    rig.monitor.lose()
    rig.monitor.silent(0.9)
    assert len(rig.published) == published
    refused = "paused: no pose: dynamics is silent; no goal is taken during a pause"
    assert rig.monitor.goto(OTHER) == refused
    assert rig.at(ONE_UP).state == "MOVING"
    assert rig.state.reason.startswith("went on after a pause: no pose")
    assert (rig.monitor.setpoint().position, rig.monitor.setpoint().brake) == (INSIDE, False)


def test_beyond_the_grace_the_flight_ends_even_if_poses_return():
    rig = Rig().moving()
    rig.monitor.lose()
    rig.monitor.silent(1.1, own=0.9)
    assert (rig.state.state, rig.state.reason) == ("HOVERING", "no pose for 1 s: stopped")
    assert rig.at(ONE_UP).state == "HOVERING"
    assert rig.monitor.setpoint().brake
    assert rig.monitor.goto(INSIDE) == ""


def test_a_pose_timeout_above_the_grace_is_respected():
    rig = Rig(pose_timeout=2.0).moving()
    rig.monitor.silent(1.5)
    assert rig.state.state == "MOVING"
    rig.monitor.silent(2.1)
    assert rig.state.reason == "no pose for 2 s: stopped"


@pytest.mark.parametrize("what", ["toggle", "resize", "hold", "boot"])
def test_a_change_during_a_pause_ends_the_flight(what: str):
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


def test_a_lagging_vehicle_continues_only_within_the_grace():
    rig = Rig().moving()
    rig.monitor.lagged("the vehicle received no setpoint for 0.4 s", 0.4)
    assert rig.state.state == "MOVING"
    assert rig.state.reason == "went on after a pause: the vehicle received no setpoint for 0.4 s"
    rig.monitor.lagged("the vehicle received no setpoint for 1.4 s", 1.4)
    assert (rig.state.state, rig.monitor.setpoint().brake) == ("HOVERING", True)


def test_lost_poses_while_hovering_only_refuse_goals():
    rig = Rig().hovering()
    before = rig.state
    rig.monitor.lose()
    assert rig.state == before
    assert rig.monitor.goto(INSIDE) == "no pose: dynamics is silent"


def test_an_old_or_reordered_pose_is_ignored():
    rig = Rig().moving()
    now = rig.monitor.pose
    rig.monitor.see(rig.pose(now.stamp - 0.01, INSIDE))
    assert rig.monitor.pose is now
    assert rig.state.state == "MOVING"
    rig.monitor.lose()
    rig.monitor.see(rig.pose(now.stamp - 0.01, ONE_UP))
    assert not rig.monitor.fresh


def test_a_pose_of_a_boot_that_is_over_is_ignored():
    rig = Rig().hovering()
    rig.at(ONE_UP, boot="b2")
    now = rig.monitor.pose
    assert rig.at(INSIDE, boot="b1").boot == "b2"
    assert rig.monitor.pose is now


def test_a_new_boot_drops_the_goal_and_takes_off_again():
    rig = Rig().moving()
    rig.monitor.see(rig.pose(0.0, Position(0.0, 0.0, 0.5), boot="b2"))
    state = rig.state
    assert (state.boot, state.state, state.goal.z) == ("b2", "HOVERING", 0.5)
    assert state.reason == "the simulation restarted: the goal is dropped"
    assert rig.monitor.setpoint().brake
    rig.monitor.see(rig.pose(0.0, GROUND, boot="b3"))
    assert (rig.state.boot, rig.state.state, rig.state.goal) == ("b3", "MOVING", ONE_UP)
    assert any(state.reason.startswith("the simulation restarted") for state, _ in rig.published)


@pytest.mark.parametrize("z", [0.0, 1.0])
def test_after_a_restart_the_vehicle_hovers_with_the_cage_on(z: float):
    rig = Rig(restarted=True, cage_on=False)
    assert rig.state.cage_on
    here = Position(7.0, 0.0, z)
    state = rig.at(here)
    assert (state.state, state.goal, state.cage_on) == ("HOVERING", here, True)
    assert state.reason == "safety restarted: hovering here, cage on"
    assert rig.monitor.setpoint().brake
    # From outside the vehicle may fly back in; later boots are handled as usual.
    assert rig.monitor.goto(INSIDE) == ""
    assert rig.at(GROUND, boot="b2").goal == ONE_UP


def turn_on(rig: Rig) -> None:
    rig.monitor.toggle(cage_on=True)


def shrink(rig: Rig) -> None:
    rig.monitor.toggle(cage_on=True)
    rig.params.virtual_cage.x = 2.0
    rig.monitor.resize()


@pytest.mark.parametrize(("change", "goal"), [(turn_on, OUTSIDE), (shrink, INSIDE)])
def test_a_cage_that_excludes_the_goal_stops_the_flight(
    change: Callable[[Rig], None], goal: Position
):
    rig = Rig(cage_on=False).hovering()
    assert rig.monitor.goto(goal) == ""
    rig.at(Position(1.0, 0.0, 1.0), Velocity(3.0, 0.0, 0.0))
    change(rig)
    state = rig.state
    assert (state.state, state.cage_on, state.goal.x) == ("HOVERING", True, 1.0)
    assert state.reason.startswith("stopped, the goal is now outside the cage: x = ")
    assert rig.monitor.setpoint().brake


def test_a_cage_that_includes_the_goal_lets_the_flight_continue():
    rig = Rig(cage_on=False).moving()
    rig.monitor.toggle(cage_on=True)
    rig.params.virtual_cage.x = 3.0
    rig.monitor.resize()
    assert (rig.state.state, rig.state.goal) == ("MOVING", INSIDE)
    assert rig.state.cage == CageSize(3.0, 5.0, 2.0)
    assert rig.published[-1][0].cage == CageSize(3.0, 5.0, 2.0)


LIMIT, PERIOD = 0.15, 0.05
GOAL, OTHER_GOAL = (3.0, 0.0, 1.0), (0.0, 3.0, 1.0)
STILL = Velocity(0.0, 0.0, 0.0)


def look(
    tracking: TrackingMonitor,
    stamp: float,
    goal: Point | None = GOAL,
    *,
    boot: str = "b1",
    velocity: Velocity = POSE.velocity,
    moving: bool = True,
) -> str:
    pose = replace(POSE, boot=boot, stamp=stamp, velocity=velocity)
    gap, stuck = tracking.observe(pose, goal, moving=moving, setpoint_timeout=LIMIT)
    return STOOD_STILL if stuck else f"{gap:.2g} s" if gap > LIMIT else ""


def test_poses_in_time_show_no_fault():
    tracking = TrackingMonitor()
    assert [look(tracking, count * PERIOD) for count in range(100)] == [""] * 100


def test_late_poses_show_a_vehicle_without_setpoints():
    tracking = TrackingMonitor()
    look(tracking, 1.0)
    assert look(tracking, 1.0 + LIMIT - 0.01) == ""
    assert look(tracking, 1.5) == "0.36 s"
    assert look(tracking, 1.55) == ""


def test_a_gap_before_a_new_goal_is_no_fault():
    tracking = TrackingMonitor()
    look(tracking, 1.0, None)
    assert look(tracking, 2.0) == ""
    assert look(tracking, 3.0, OTHER_GOAL) == ""
    assert look(tracking, 4.0, None) == ""
    assert look(tracking, 5.0, None) == ""


def test_a_new_boot_restarts_the_time():
    tracking = TrackingMonitor()
    look(tracking, 1.0)
    assert look(tracking, 9.0, boot="b2") == ""


def test_repeated_stamps_of_a_paused_simulation_are_no_fault():
    tracking = TrackingMonitor()
    look(tracking, 1.0)
    assert [look(tracking, 1.0) for _ in range(20)] == [""] * 20
    assert look(tracking, 1.05) == ""


def test_a_vehicle_that_stops_on_its_way_is_a_fault():
    tracking = TrackingMonitor()
    at = [count * PERIOD for count in range(round(PATIENCE / PERIOD) + 3)]
    faults = [look(tracking, stamp, velocity=STILL) for stamp in at]
    assert faults == [*[""] * (len(at) - 1), "the vehicle stood still for 1 s on its way"]


def test_a_vehicle_without_setpoints_is_not_at_fault_for_standing_still():
    tracking = TrackingMonitor()
    # It has not yet left when the setpoints stop; after they return it has its whole time again.
    assert [look(tracking, stamp, velocity=STILL) for stamp in (0.0, 0.05, 0.1)] == [""] * 3
    late = 0.1 + PATIENCE + 0.05
    assert look(tracking, late, velocity=STILL) == f"{late - 0.1:.2g} s"
    at = [late + count * PERIOD for count in range(1, round(PATIENCE / PERIOD) + 3)]
    faults = [look(tracking, stamp, velocity=STILL) for stamp in at]
    first = faults.index(STOOD_STILL)
    assert at[first] - late > PATIENCE >= at[first - 1] - late
    assert set(faults[:first]) == {""}


def test_each_new_goal_restarts_the_standstill_timer():
    tracking = TrackingMonitor()
    for count in range(100):
        goal = Position(1.0, 0.0, count // 19)
        assert look(tracking, count * PERIOD, goal, velocity=STILL) == ""


def test_standstill_is_measured_per_move_and_only_in_flight():
    tracking = TrackingMonitor()
    for count in range(200):
        still = STILL if count % 20 else POSE.velocity
        assert look(tracking, count * PERIOD, velocity=still) == ""
    for count in range(200, 300):
        assert look(tracking, count * PERIOD, velocity=STILL, moving=False) == ""
        assert tracking.due == inf


def test_before_the_first_pose_goals_are_refused():
    rig = Rig()
    assert rig.monitor.goto(INSIDE) == "no pose: dynamics is silent"
    assert (rig.state.state, rig.state.request, rig.state.boot) == ("HOVERING", 1, "")
    assert rig.monitor.setpoint().brake


def test_the_takeoff_is_verified_and_flown():
    rig = Rig()
    state = rig.at(GROUND)
    assert (state.state, state.goal, state.request, state.boot) == ("MOVING", ONE_UP, 1, "b1")
    assert rig.monitor.setpoint() == replace(
        rig.monitor.setpoint(), boot="b1", for_seq=1, position=ONE_UP, brake=False
    )
    assert [state.state for state, _ in rig.published] == ["HOVERING", "VERIFYING", "MOVING"]


@pytest.mark.parametrize(
    ("start", "height", "reason"),
    [
        (Position(9.0, 0.0, 0.0), 1.0, BEYOND),
        (GROUND, 3.0, "outside the cage: z = 3 is beyond [0, 2]"),
    ],
)
def test_a_takeoff_outside_the_cage_is_refused_with_its_reason(
    start: Position, height: float, reason: str
):
    rig = Rig(takeoff=height)
    state = rig.at(start)
    assert (state.state, state.reason, state.goal) == ("HOVERING", reason, start)
    assert rig.monitor.setpoint().brake
    assert rig.at(start).state == "HOVERING"


def test_with_the_cage_off_the_takeoff_is_not_refused():
    assert Rig(cage_on=False).at(Position(9.0, 0.0, 0.0)).state == "MOVING"


@pytest.mark.parametrize(("takeoff", "z"), [(0.0, 0.0), (1.0, 0.05), (1.0, 1.5)])
def test_there_is_no_takeoff_at_height_0_or_in_the_air(takeoff: float, z: float):
    start = Position(1.0, 1.0, z)
    state = Rig(takeoff=takeoff).at(start)
    assert (state.state, state.goal, state.request) == ("HOVERING", start, 0)


def test_the_first_goal_replaces_the_takeoff_and_the_next_is_busy():
    rig = Rig()
    rig.at(GROUND)
    assert rig.monitor.goto(INSIDE) == ""
    assert rig.state.goal == INSIDE
    assert rig.monitor.goto(OTHER).startswith("busy: flying to (3, 0, 1)")


def test_a_refused_goal_keeps_the_takeoff_going_and_replaceable():
    rig = Rig()
    rig.at(GROUND)
    assert rig.monitor.goto(OUTSIDE) == BEYOND
    assert (rig.state.state, rig.state.goal) == ("MOVING", ONE_UP)
    assert rig.monitor.goto(INSIDE) == ""


def test_arrival_within_the_range_makes_safety_ready_again():
    rig = Rig().moving()
    assert rig.at(Position(2.5, 0.0, 1.0)).state == "MOVING"
    state = rig.at(Position(2.501, 0.0, 1.0))
    assert (state.state, state.goal, state.reason) == ("HOVERING", INSIDE, "")
    assert not rig.monitor.setpoint().brake
    assert rig.monitor.goto(OTHER) == ""


def test_a_goal_outside_is_refused_and_the_vehicle_stays():
    rig = Rig().hovering()
    before = rig.monitor.setpoint()
    assert rig.monitor.goto(OUTSIDE) == BEYOND
    assert rig.monitor.setpoint() == before
    assert (rig.state.state, rig.state.reason) == ("HOVERING", BEYOND)


@pytest.mark.parametrize("cage_on", [True, False])
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_a_goal_that_is_not_finite_is_refused_even_with_the_cage_off(cage_on: bool, value: float):
    rig = Rig(cage_on=cage_on).hovering()
    before = rig.monitor.setpoint()
    for axis in "xyz":
        assert f"{axis} = {value}" in rig.monitor.goto(replace(INSIDE, **{axis: value}))
    assert rig.monitor.setpoint() == before
    assert rig.state.state == "HOVERING"


def test_goals_are_busy_until_replaced_and_a_bad_one_changes_nothing():
    rig = Rig().moving()
    assert rig.monitor.goto(OTHER).startswith("busy: flying to (3, 0, 1)")
    assert rig.monitor.goto(OUTSIDE, replace=True) == BEYOND
    assert (rig.state.state, rig.state.goal, rig.state.reason) == ("MOVING", INSIDE, BEYOND)
    assert not rig.monitor.setpoint().brake
    assert rig.monitor.goto(OTHER, replace=True) == ""
    assert (rig.state.state, rig.state.goal, rig.state.reason) == ("MOVING", OTHER, "")


def test_every_request_is_counted_so_that_equal_refusals_differ():
    rig = Rig().hovering()
    counts = []
    for ask in (OUTSIDE, OUTSIDE, INSIDE, OTHER, OTHER):
        rig.monitor.goto(ask)
        counts.append(rig.state.request)
    assert counts == [2, 3, 4, 5, 6]
    assert [state.request for state, _ in rig.published if state.reason == BEYOND] == [2, 3]


def test_a_vehicle_that_has_rested_for_long_at_its_goal_may_be_sent_there_again():
    rig = Rig().moving()
    monitor, patience = rig.monitor, 2.0
    monitor.watch(monitor.pose, 0.0, patience)
    for _ in range(20):
        rig.at(INSIDE)
        assert not monitor.watch(monitor.pose, 0.0, patience)
    assert monitor.goto(INSIDE) == ""
    assert not monitor.watch(monitor.pose, 0.0, patience)
    assert (rig.state.state, rig.state.reason) == ("MOVING", "")


def test_the_log_shows_each_request_and_its_result():
    rig = Rig().hovering()
    rig.published.clear()
    rig.monitor.goto(Position(3.0, 0.5, 1.0))
    rig.monitor.goto(OTHER)
    rig.monitor.toggle(cage_on=False)
    assert [line for _, line in rig.published] == [
        "Requested position: (3, 0.5, 1). Current State: VERIFYING",
        "Current State: MOVING",
        "Requested position: (0, 3, 1). busy: flying to (3, 0.5, 1); ask with replace to change course",
        "Cage: off",
    ]
    assert rig.monitor.situation.state is State.MOVING


WIND = "it cannot hold itself: wind of 10 m/s"


def test_a_vehicle_that_lands_by_itself_is_stopped_and_takes_no_goal():
    rig = Rig().moving()
    rig.monitor.set_landing(WIND)
    assert (rig.state.state, rig.state.reason) == ("HOVERING", f"stopped and landing, {WIND}")
    assert rig.monitor.setpoint().brake
    published = len(rig.published)
    rig.monitor.set_landing(WIND)
    assert len(rig.published) == published
    assert rig.monitor.goto(OTHER) == f"the vehicle lands: {WIND}"
    assert rig.at(ONE_UP).state == "HOVERING"
    rig.monitor.set_landing("")
    assert rig.monitor.goto(OTHER) == ""


@pytest.mark.parametrize("seed", range(4))
def test_two_vehicles_are_judged_alike_whether_or_not_their_rest_is_quiet(
    seed: int, monkeypatch: pytest.MonkeyPatch
):
    heard: list[bool] = []
    see = Monitor.see

    def count(monitor: Monitor, pose: Pose) -> bool:
        heard.append(see(monitor, pose))
        return heard[-1]

    monkeypatch.setattr(Monitor, "see", count)
    quiet = flown(Random(seed))
    assert 0.05 * len(heard) < heard.count(False) < 0.9 * len(heard)
    monkeypatch.setattr("quadctl.services.safety.monitor.is_quiet", lambda *_: False)
    assert flown(Random(seed)) == quiet


def flown(draws: Random) -> list[tuple[Setpoint, SafetyState]]:
    """Return what two monitors decide in each period of some goals, holds and changes, each with a long rest."""
    params, traffic = SafetyParams(takeoff=0.0), Traffic()
    starts = Position(-1.0, 0.0, 0.0), Position(1.0, 0.0, 1.0)
    flights = [
        MonitoredVehicle(params, start, f"uav{number}", traffic)
        for number, start in enumerate(starts)
    ]
    decided = []
    for _ in range(8):
        flight = draws.choice(flights)
        monitor, (x, y, z) = flight.monitor, (draws.uniform(-3.0, 3.0) for _ in range(3))
        match draws.randrange(6):
            case 0:
                monitor.toggle(cage_on=draws.random() < 0.7)
            case 1:
                monitor.hold()
            case 2:
                params.virtual_cage.x = draws.choice((0.5, 5.0))
                for each in flights:
                    each.monitor.resize()
            case _:
                monitor.goto(Position(x, y, abs(z)), replace=True, wait=True)
        for _ in periods(draws.choice((0.5, 2.0, 15.0))):
            for each in flights:
                each.see()
                each.obey()
                for _ in range(LOOKS):
                    each.advance()
                decided.append((each.monitor.setpoint(), each.monitor.state()))
    return decided
