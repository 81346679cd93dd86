"""Vehicle of the Python API, on a system of the test's own."""

import math
import threading

import numpy as np
import pytest

import quadctl
from quadctl.schemas.messages import Position
from quadctl.schemas.topics import SETPOINT

LOCKSTEP = pytest.mark.quad(params={"dynamics.speed": 0})
CALM = {"safety.pose_timeout": 0.6, "dynamics.setpoint_timeout": 0.6}
"""Parameters with which a busy machine does not stop a flight in real time."""


@LOCKSTEP
def test_a_goal_is_reached_and_one_outside_is_refused_with_the_reason(quad):
    arrival = quad.goto(1, 2, 1)
    assert arrival.distance <= 0.5
    # Only at least: in lock-step seconds pass by while a busy machine keeps this process waiting.
    assert arrival.seconds > 1
    rest = quad.goto(2, 2, 1, settle=True)
    assert rest.distance < 0.02
    assert rest.seconds > 1
    with pytest.raises(quadctl.Refused) as refused:
        quad.goto(9, 0, 1)
    assert refused.value.reason == "outside the cage: x = 9 is beyond [-5, 5]"
    assert refused.value.exit_code == 5
    quad.cage(on=False)
    assert not quad.state().cage_on
    assert quad.goto(6, 0, 1).distance <= 0.5


@pytest.mark.thorough
@pytest.mark.quad(params=CALM)
def test_a_flight_is_followed_replaced_and_stopped(quad):
    first = quad.goto(4, 0, 1, wait=False)
    assert first.accepted
    assert not first.arrived
    with pytest.raises(quadctl.Refused, match="busy"):
        quad.goto(0, 4, 1)
    second = quad.goto(0, 4, 1, replace=True, wait=False)
    with pytest.raises(quadctl.Refused, match="another goal was accepted in its place"):
        first.wait()
    assert first.reason == "another goal was accepted in its place"
    with pytest.raises(quadctl.TimedOut, match=r"not there after 0.1 s"):
        second.wait(timeout=0.1)
    assert second.begin() < math.inf
    quad.hold()
    with pytest.raises(quadctl.Refused) as stopped:
        second.wait()
    assert stopped.value.reason == "hold: stopped on request"
    assert quad.state().reason == "hold: stopped on request"


@pytest.mark.thorough
@pytest.mark.parametrize("speed", [0, 1])
def test_a_program_waits_for_the_end_of_the_take_off(speed):
    with quadctl.launch(params=CALM | {"dynamics.speed": speed}) as run:
        quad = run.vehicle
        pose = quad.settle()
        assert abs(pose.position.z - 1) < 0.02
        assert quad.state().state == "HOVERING"
        assert quad.calibrate().spread < 0.02
        again = quad.settle()  # it hovers already
        assert again.stamp > pose.stamp
        quad.reset()
        assert abs(quad.settle().position.z - 1) < 0.02


@pytest.mark.thorough
@pytest.mark.quad(params=CALM)
def test_a_vehicle_that_does_not_settle_in_time_is_reported_with_the_cause(quad):
    with pytest.raises(quadctl.TimedOut, match=r"not hover after 0.1 s: safety is MOVING"):
        quad.settle(timeout=0.1)
    quad.settle()
    quad.params["dynamics.wind.gust"] = 3.0
    with pytest.raises(quadctl.TimedOut, match=r"does not rest within 1.5 s") as restless:
        quad.settle(timeout=1.5)
    assert "wind" in restless.value.hint


@pytest.mark.thorough
@LOCKSTEP
def test_the_barometer_is_calibrated_and_the_vehicle_put_back(quad):
    found = quad.calibrate()
    assert found.samples >= 1
    assert found.baseline == quad.pressure().baseline
    assert abs(quad.pressure().pressure) < 1
    assert quad.calibrate(unset=True).baseline == 0
    boot = quad.pose().boot
    quad.reset()
    assert quad.pose().boot != boot


@pytest.mark.thorough
@LOCKSTEP
def test_a_watch_yields_messages_until_its_end_and_counts_the_lost(quad):
    stamps = [pose.stamp for pose in quad.watch("pose", seconds=1)]
    assert len(stamps) > 1
    assert stamps == sorted(stamps)
    slow = quad.watch("pose", seconds=60)
    while not slow.lost:  # more than 10 000 unread ones at some 50 times real time
        next(quad.watch("state", seconds=60))
    assert next(slow).stamp > stamps[-1]
    assert next(quad.watch(SETPOINT)).boot == quad.pose().boot
    assert next(quad.watch("sensors/pressure")).samples >= 0
    with pytest.raises(quadctl.Invalid, match="there is no topic sensors/presure") as unknown:
        quad.watch("sensors/presure")
    assert unknown.value.hint == "did you mean sensors/pressure?"


@pytest.mark.thorough
@LOCKSTEP
def test_parameters_change_all_or_none_across_nodes(quad, quad_run):
    quad.params["safety.acceptance_range"] = 0.25
    assert quad.params["safety.acceptance_range"] == 0.25
    assert quad.params["safety.virtual_cage"]["safety.virtual_cage.x"] == 5.0
    quad.params.update({"safety.takeoff": 2.0, "pressure.noise": 0.001})
    assert (quad.params["safety.takeoff"], quad.params["pressure.noise"]) == (2.0, 0.001)
    with pytest.raises(quadctl.Invalid, match=r"nothing was changed: pressure.noise"):
        quad.params.update({"safety.takeoff": 3.0, "pressure.noise": -1.0})
    assert quad.params["safety.takeoff"] == 2.0
    with pytest.raises(quadctl.Invalid, match=r"did you mean safety.acceptance_range"):
        quad.params["safety.acceptance_rage"] = 1.0
    with pytest.raises(quadctl.Invalid, match="fixed at launch"):
        quad.params["supervise.patience"] = 1.0
    assert "dynamics.vehicle.mass" in set(quad.params)
    assert repr(quad.params) == f"<parameters of uav in the realm {quad_run.realm}>"


def test_bad_coordinates_are_refused_before_anything_is_sent(quad):
    for bad in (math.nan, math.inf, 1e6):
        with pytest.raises(quadctl.Invalid, match=r"y = .* is not a valid coordinate"):
            quad.goto(0, bad, 1)
    for bad, shown in (
        ("a", "'a'"),
        (None, "None"),
        (True, "True"),
        (np.True_, ".*True.*"),
        ([1], ".*"),
    ):
        with pytest.raises(
            quadctl.Invalid, match=rf"x = {shown} is not a valid coordinate"
        ) as said:
            quad.goto(bad, 0, 1)
        assert "coordinates are metres" in said.value.hint
        assert said.value.__suppress_context__ or said.value.__context__ is None
    with pytest.raises(quadctl.Invalid, match=r"x = 1000.* is not a valid coordinate"):
        quad.goto(10**400, 0, 1)
    assert quad.state().request <= 1  # the take-off alone


@pytest.mark.thorough
@LOCKSTEP
def test_numbers_of_numpy_are_coordinates(quad):
    arrival = quad.goto(np.float64(1.0), np.int64(2), np.float32(1.0))
    assert arrival.distance <= 0.5
    assert quad.state().goal == Position(1.0, 2.0, 1.0)
    quad.goto(*np.array([0.0, 0.0, 1.0]))


@pytest.mark.quad(vehicles=2, params={"dynamics.speed": 0, "uav1.safety.takeoff": 2.0})
def test_several_vehicles_fly_at_the_same_time(quad_run):
    with pytest.raises(quadctl.Error, match="there are several vehicles: uav0, uav1"):
        _ = quad_run.vehicle
    assert list(quad_run.vehicles) == ["uav0", "uav1"]
    assert quad_run.vehicles["uav1"].params["safety.takeoff"] == 2.0
    arrivals: dict[str, float] = {}

    def fly(name: str) -> None:
        x = float(name[-1])  # apart
        arrivals[name] = quad_run.vehicles[name].goto(x, 0, 2, replace=True).distance

    threads = [threading.Thread(target=fly, args=(name,)) for name in quad_run.vehicles]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert set(arrivals) == {"uav0", "uav1"}
    assert max(arrivals.values()) <= 0.5


@pytest.mark.thorough
def test_calls_leave_no_subscription_behind(quad):
    """A flight that nobody waits for ends its subscription, too, once it is not used any more."""
    flight = quad.goto(0, 0, 1.3, replace=True, wait=False)
    stream = flight._messages._stream._subscriber
    quad.goto(0, 0, 1.2, replace=True)
    watch = quad.watch("pose")
    watched = watch._messages._stream._subscriber
    assert stream._subscribers
    assert watched._subscribers
    del flight, watch
    assert not stream._subscribers
    assert not watched._subscribers
