"""Guards of the monitor in flight: pose jumps, leaving the cage, and returning."""

from math import dist, sqrt

import pytest
from hypothesis import given, strategies as st
from msgspec.structs import astuple, replace

from quadctl.schemas.messages import CageSize, Position, Velocity
from quadctl.schemas.params import DynamicsParams, MeanWindParams, SafetyParams, WindParams
from quadctl.schemas.topics import SETPOINT
from quadctl.schemas.vehicle import ControlParams, VehicleParams
from quadctl.services.airspace import stopping
from quadctl.services.airspace.cage import why_outside
from quadctl.services.airspace.stopping import StoppingLaw, soonest_stop
from tests.support.monitor_rig import INSIDE, ONE_UP, OTHER, OUTSIDE, STILL, Rig
from tests.support.monitored_vehicle import LOOKS, MonitoredVehicle, periods
from tests.support.worlds import POSE

CAGE = CageSize(5.0, 4.0, 2.0)
NUMBERS = st.floats(-20, 20, allow_subnormal=False).filter(lambda x: x == 0 or abs(x) > 1e-100)
AWAY = Position(7.0, 0.0, 1.0)


def along(x: float) -> Position:
    return Position(x, 0.0, 1.0)


def going(vx: float) -> Velocity:
    return Velocity(vx, 0.0, 0.0)


def outside() -> Rig:
    """Return a rig hovering two metres outside a wall, with the cage on."""
    rig = Rig(cage_on=False).hovering()
    assert rig.monitor.goto(AWAY) == ""
    rig.at(along(4.0))
    rig.at(AWAY)
    rig.monitor.toggle(cage_on=True)
    assert rig.at(AWAY).state == "HOVERING"
    return rig


@pytest.mark.parametrize("start", ["hovering", "moving"])
def test_a_pose_that_jumps_stops_the_vehicle(start: str):
    rig = getattr(Rig(), start)()
    rig.at(along(0.5))
    state = rig.at(along(-11.0))
    assert (state.state, state.goal.x) == ("HOVERING", -11.0)
    assert state.reason == "stopped, the pose jumped by 11.5 m in 1 s"
    assert rig.monitor.setpoint().brake


def test_a_pose_within_the_margin_of_the_top_speed_is_no_jump():
    rig = Rig(cage_on=False).hovering()
    assert rig.at(along(10.009)).reason == ""


def test_a_new_boot_at_another_place_is_no_jump():
    rig = Rig().hovering()
    assert rig.at(Position(30.0, 0.0, 1.0), boot="b2").reason.startswith("the simulation restarted")


def test_a_vehicle_that_can_no_longer_stop_inside_is_stopped():
    rig = Rig().moving()
    assert rig.at(along(2.0), going(5.0)).state == "MOVING"
    # Stopping from 6.5 m/s takes at least 2.1 m.
    state = rig.at(along(3.0), going(6.5))
    assert (state.state, state.goal.x) == ("HOVERING", 3.0)
    assert state.reason == "stopped, the path led out of the cage by 0.11 m"


def test_a_vehicle_that_is_declared_to_react_late_is_stopped_earlier():
    rig = Rig(reaction=0.5).moving()
    # At 4 m/s it flies on for 2 m, and brakes for 0.8 m.
    assert rig.at(along(2.1), going(4.0)).state == "MOVING"
    state = rig.at(along(2.3), going(4.0))
    assert state.reason == "stopped, the path led out of the cage by 0.1 m"


def test_with_the_cage_off_a_vehicle_is_not_stopped():
    rig = Rig(cage_on=False).moving()
    assert rig.at(along(4.5), going(6.0)).state == "MOVING"


def test_one_centimetre_beyond_a_wall_is_tolerated():
    rig = Rig().moving()
    rig.at(along(4.0))
    assert rig.at(along(5.0099)).state == "MOVING"
    rig = Rig().moving()
    rig.at(along(4.0))
    assert rig.at(along(5.0101), going(0.01)).state == "HOVERING"


def test_a_return_from_outside_may_not_move_outwards():
    rig = outside()
    assert rig.monitor.goto(OTHER) == ""
    for x in (6.8, 6.1, 5.4):
        assert rig.at(along(x), going(-0.5)).state == "MOVING"
    state = rig.at(along(5.5), going(0.1))
    assert state.state == "HOVERING"
    assert state.reason == "stopped, the path led out of the cage by 0.5 m"
    # The vehicle hovers there, and may be sent inside again.
    rig.at(along(5.5))
    assert rig.monitor.goto(OUTSIDE) != ""
    assert rig.monitor.goto(INSIDE) == ""


def test_an_unavoidable_exit_is_tolerated_while_the_vehicle_slows():
    rig = Rig(cage_on=False).hovering()
    assert rig.monitor.goto(OUTSIDE) == ""
    rig.at(along(4.0), going(5.0))
    assert rig.monitor.goto(INSIDE, replace=True) == ""
    rig.monitor.toggle(cage_on=True)
    for x, vx in ((4.9, 4.0), (5.6, 3.0), (6.1, 1.0), (6.2, 0.0), (6.1, -1.0)):
        assert rig.at(along(x), going(vx)).state == "MOVING"
    assert rig.at(along(6.2), going(0.5)).state == "HOVERING"


def test_turning_the_cage_on_stops_a_vehicle_that_has_arrived():
    rig = Rig(cage_on=False, acceptance_range=4.0).hovering()
    assert rig.monitor.goto(OUTSIDE) == ""
    assert rig.at(along(5.5), going(3.0)).state == "HOVERING"
    assert not rig.monitor.setpoint().brake
    rig.monitor.toggle(cage_on=True)
    assert (rig.state.state, rig.state.goal.x) == ("HOVERING", 5.5)
    assert rig.state.reason.startswith("hovering in place, the goal is now outside the cage: x = 9")
    assert rig.monitor.setpoint().brake


@pytest.mark.parametrize("cage_on", [True, False])
def test_a_smaller_cage_stops_the_vehicle_only_when_on(cage_on: bool):
    rig = Rig(cage_on=cage_on).moving()
    rig.at(along(2.8))
    rig.params.virtual_cage.x = 1.0
    rig.monitor.resize()
    assert rig.monitor.setpoint().brake is cage_on


FACES = {
    "east": Position(1.0, 0.0, 0.0),
    "west": Position(-1.0, 0.0, 0.0),
    "north": Position(0.0, 1.0, 0.0),
    "south": Position(0.0, -1.0, 0.0),
    "top": Position(0.0, 0.0, 1.0),
    "floor": Position(0.0, 0.0, -1.0),
}
WALLS = {"east": 5.0, "west": 5.0, "north": 5.0, "south": 5.0, "top": 1.0, "floor": 1.0}
"""Distance of each face from ONE_UP, m."""


@pytest.mark.parametrize("distance", [0.3, 2.0, 6.0])
@pytest.mark.parametrize("face", FACES)
def test_outside_any_face_the_vehicle_hovers_and_accepts_only_goals_inside(
    face: str, distance: float
):
    def out(metres: float) -> Position:
        """Return the place some metres outside the face."""
        way, (x, y, z) = WALLS[face] + metres, astuple(FACES[face])
        return Position(way * x, way * y, 1.0 + way * z)

    rig = Rig(cage_on=False).hovering()
    for part in (0.3, 0.6, 1.0):
        rig.at(out(part * distance))
    rig.monitor.hold()
    rig.at(out(distance))
    rig.monitor.toggle(cage_on=True)
    assert (rig.state.state, rig.state.cage_on) == ("HOVERING", True)
    assert rig.state.goal == out(distance)
    for goal in (out(distance), out(distance / 2), out(1e-9)):
        assert rig.monitor.goto(goal) != ""
        assert (rig.state.state, rig.state.goal) == ("HOVERING", out(distance))
    assert rig.monitor.goto(ONE_UP) == ""
    for part in (0.9, 0.5, 0.2):
        assert rig.at(out(part * distance)).state == "MOVING"
    outwards = Velocity(*astuple(FACES[face]))
    assert rig.at(out(0.3 * distance), outwards).state == "HOVERING"


def test_progress_of_a_return_is_not_published():
    rig = outside()
    rig.monitor.goto(INSIDE)
    rig.published.clear()
    rig.at(along(6.5), going(-1.0))
    rig.at(along(6.0), going(-1.0))
    assert rig.published == []
    assert rig.monitor.situation.beyond == 1.0


@given(NUMBERS, NUMBERS, NUMBERS)
def test_the_distance_from_the_cage_is_never_overestimated(x: float, y: float, z: float):
    out = stopping.outside(x, y, z, *astuple(CAGE))
    assert (out == 0.0) is (why_outside((x, y, z), CAGE) == "")
    way = sqrt((x - CAGE.x) ** 2 + (y - CAGE.y) ** 2 + (z - CAGE.z) ** 2)
    assert out <= way * (1 + 1e-12)


@given(NUMBERS, NUMBERS, st.floats(0.1, 100))
def test_the_stopping_distance_is_v_squared_over_2_a(x: float, vx: float, deceleration: float):
    pose = replace(POSE, position=along(x), velocity=going(vx))
    stop, *rest = soonest_stop(pose, deceleration)
    assert rest == [0.0, 1.0]
    assert abs(stop - x) == pytest.approx(vx * vx / (2 * deceleration), abs=1e-9)
    assert (stop - x) * vx >= 0
    assert soonest_stop(replace(pose, velocity=STILL), deceleration) == (x, 0.0, 1.0)


def test_a_declared_reaction_is_a_part_of_the_way_to_a_stop():
    pose = replace(POSE, position=along(1.0), velocity=going(2.0))
    assert soonest_stop(pose, 4.0, 0.25)[0] == 1.0 + 0.5 + 0.5


def test_the_widest_law_since_the_boot_is_the_one_that_counts():
    rig = Rig().hovering()
    before = rig.monitor.stop
    slow = StoppingLaw(2 * before.response, before.acceleration, 0.1)
    rig.monitor.set_stop(slow, 0.2)
    assert rig.monitor.stop == slow
    # Until its next standstill the vehicle flies by the old value.
    rig.monitor.set_stop(before, 0.0)
    assert rig.monitor.stop == slow
    rig.at(ONE_UP, boot="b2")
    assert rig.monitor.stop == before


def test_a_change_of_wind_counts_from_each_one_of_the_last_seconds():
    def blow(rig: Rig, x: float) -> float:
        rig.monitor.set_vehicle(VehicleParams(), ControlParams(), WindParams(MeanWindParams(x)))
        return rig.monitor.margin

    def turned(*winds: float, pause: int = 0) -> float:
        rig = Rig().hovering()
        for x in winds:
            margin = blow(rig, x)
            for _ in range(pause):
                rig.at(ONE_UP)
        # A new boot begins in the wind that blows.
        rig.at(ONE_UP, boot="b2")
        assert rig.monitor.margin == blow(Rig().hovering(), winds[-1])
        assert blow(rig, winds[-1]) == rig.monitor.margin
        return margin

    at_once, apart = turned(-5.0, 5.0), turned(-5.0, 0.0, 5.0, pause=3)
    assert turned(-5.0, 0.0, 5.0) == turned(-5.0, *(-5 + x / 9 for x in range(90)), 5.0) == at_once
    assert turned(-5.0) == apart < at_once


def blowing(x: float, gust: float) -> DynamicsParams:
    return DynamicsParams(wind=WindParams(MeanWindParams(x), gust))


@pytest.mark.parametrize("steps", [(8.0,), (0.0, 8.0), (5.0,)], ids=str)
@pytest.mark.parametrize("gust", [0.0, 0.02])
def test_a_wind_that_turns_round_stops_no_flight_at_a_wall(steps: tuple[float, ...], gust: float):
    params = blowing(-steps[-1], gust)
    flown = MonitoredVehicle(SafetyParams(takeoff=0.0), Position(4.95, 0.0, 2.0), body=params)
    rig, worst = flown.monitor, 0.0

    def fly(seconds: float) -> None:
        nonlocal worst
        for _ in periods(seconds):
            flown.see()
            flown.obey()
            for _ in range(LOOKS):
                flown.advance()
                worst = max(worst, dist(flown.vehicle.position, flown.vehicle.setpoint))

    flown.see()
    assert rig.goto(Position(5.0, 0.0, 2.0)) == ""
    fly(2.0)
    worst = 0.0
    for x in steps:
        params = blowing(x, gust)
        flown.vehicle.configure(params)
        rig.set_vehicle(params.vehicle, params.control, params.wind)
        fly(1 / SETPOINT.hz)
    fly(2.0)
    assert rig.situation.reason == ""
    assert worst < rig.margin


def test_a_flight_inside_the_cage_is_not_disturbed():
    rig = Rig().moving()
    published = len(rig.published)
    for x, vx in ((0.5, 3.0), (1.5, 3.0), (2.4, 1.0)):
        rig.at(along(x), going(vx))
    assert len(rig.published) == published
    assert rig.at(INSIDE).goal != ONE_UP


def test_a_cage_that_shrinks_around_a_slow_start_leaves_room_to_stop():
    rig = Rig().hovering()
    assert rig.monitor.goto(Position(0.0, 0.0, 1.9)) == ""
    # It has responded, and is so slow still that it counts as at rest.
    rig.at(ONE_UP, Velocity(0.0, 0.0, 0.045))
    rig.params.virtual_cage.z = 0.5
    rig.monitor.resize()
    stopped = "stopped, the goal is now outside the cage: z = 1.9 is beyond [0, 0.5]"
    assert rig.state.reason == stopped
    assert rig.at(Position(0.0, 0.0, 1.04), Velocity(0.0, 0.0, 0.08)).reason == stopped
