"""Which setpoints move the vehicle."""

from msgspec import structs

from quadctl.schemas.messages import BodyRates, Pose, Position, Quaternion, Velocity
from quadctl.schemas.params import DynamicsParams, FlightFaultParams
from quadctl.services.dynamics.simulation import FaultyPose, GoalLatch
from quadctl.services.dynamics.vehicle import Vehicle


def pose(seq: int, boot: str = "a") -> Pose:
    return Pose(
        boot, seq, seq / 100, Position(seq, 0.0, 1.0), Velocity(0.0, 0.0, 0.0),
        Quaternion(1.0, 0.0, 0.0, 0.0), BodyRates(0.0, 0.0, 0.0),
    )  # fmt: skip


def test_a_sound_one_is_told_as_it_is():
    reported = FaultyPose(FlightFaultParams())
    assert all(reported.through(pose(n)) is not None for n in range(3))
    given = pose(4)
    assert reported.through(given) is given


def test_a_frozen_one_is_the_last_that_was_told():
    params = FlightFaultParams()
    reported = FaultyPose(params)
    last = reported.through(pose(1))
    params.pose = "frozen"
    assert [reported.through(pose(n)) for n in (2, 3)] == [last, last]
    params.pose = "none"
    assert reported.through(pose(4)) == pose(4)


def test_a_delayed_one_is_of_that_time_ago():
    params = FlightFaultParams(pose="delayed", delay=0.05)
    reported = FaultyPose(params)
    told = [reported.through(pose(n)).seq for n in range(12)]
    assert told == [0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6]
    # Of a boot that is over nothing is told.
    assert reported.through(pose(0, "b")).boot == "b"


def test_a_jump_is_off_the_true_place_and_nothing_else():
    reported = FaultyPose(FlightFaultParams(pose="jump", jump=-2.0))
    told = reported.through(pose(3))
    assert told.position == Position(1.0, 0.0, 1.0)
    assert structs.replace(told, position=pose(3).position) == pose(3)


def test_weak_motors_lower_the_vehicle_and_it_stays_in_the_air():
    sound, weak = DynamicsParams(), DynamicsParams(fault=FlightFaultParams(motors=0.9))
    heights = []
    for params in (sound, weak):
        params.start.z = 2.0
        vehicle = Vehicle(params)
        vehicle.goto(0.0, 0.0, 2.5)
        vehicle.advance(5000)
        heights.append(vehicle.position[2])
    assert abs(heights[0] - 2.5) < 1e-6
    # A tenth of the weight, against the gains of height and speed: 0.1 g / (1.6 x 4) m.
    assert abs(heights[1] - (2.5 - 0.981 / 6.4)) < 0.02


THERE, ELSEWHERE = Position(3.0, 0.0, 1.0), Position(0.0, 3.0, 1.0)


def stopped_on_its_way() -> GoalLatch:
    latch = GoalLatch()
    assert latch.accepts(THERE, brake=False)
    latch.stopped()
    return latch


def test_after_a_stop_of_its_own_it_does_not_resume_the_old_goal():
    latch = stopped_on_its_way()
    assert not latch.accepts(THERE, brake=False)
    assert not latch.accepts(Position(3.0, 0.0, 1.0), brake=False)


def test_within_the_grace_it_goes_on():
    latch = stopped_on_its_way()
    latch.resumed()
    assert latch.accepts(THERE, brake=False)


def test_another_goal_was_asked_for_since():
    latch = stopped_on_its_way()
    assert latch.accepts(ELSEWHERE, brake=False)
    assert latch.accepts(THERE, brake=False)


def test_a_safety_that_knows_of_the_stop_may_send_it_there_again():
    latch = stopped_on_its_way()
    assert latch.accepts(THERE, brake=True)
    assert latch.accepts(THERE, brake=False)


def test_silence_in_which_it_had_no_goal_bars_none():
    latch = GoalLatch()
    latch.stopped()
    assert latch.accepts(THERE, brake=False)
    assert latch.accepts(THERE, brake=True)
    latch.stopped()
    assert latch.accepts(THERE, brake=False)
