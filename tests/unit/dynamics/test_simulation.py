"""Faulty poses, weak motors, and the setpoints that a vehicle accepts after a stop."""

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


def test_without_a_fault_the_pose_is_unchanged():
    fault = FaultyPose(FlightFaultParams())
    assert all(fault.through(pose(n)) is not None for n in range(3))
    given = pose(4)
    assert fault.through(given) is given


def test_a_frozen_pose_repeats_the_last_published():
    params = FlightFaultParams()
    fault = FaultyPose(params)
    last = fault.through(pose(1))
    params.pose = "frozen"
    assert [fault.through(pose(n)) for n in (2, 3)] == [last, last]
    params.pose = "none"
    assert fault.through(pose(4)) == pose(4)


def test_a_delayed_pose_is_as_old_as_the_delay():
    params = FlightFaultParams(pose="delayed", delay=0.05)
    fault = FaultyPose(params)
    published = [fault.through(pose(n)).seq for n in range(12)]
    assert published == [0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6]
    # No pose of an earlier boot is published.
    assert fault.through(pose(0, "b")).boot == "b"


def test_a_jump_changes_only_the_position():
    fault = FaultyPose(FlightFaultParams(pose="jump", jump=-2.0))
    published = fault.through(pose(3))
    assert published.position == Position(1.0, 0.0, 1.0)
    assert structs.replace(published, position=pose(3).position) == pose(3)


def test_weak_motors_lower_the_vehicle_without_a_crash():
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


GOAL, OTHER_GOAL = Position(3.0, 0.0, 1.0), Position(0.0, 3.0, 1.0)


def stopped_before_its_goal() -> GoalLatch:
    latch = GoalLatch()
    assert latch.accepts(GOAL, brake=False)
    latch.stopped()
    return latch


def test_after_a_stop_the_old_goal_is_not_resumed():
    latch = stopped_before_its_goal()
    assert not latch.accepts(GOAL, brake=False)
    assert not latch.accepts(Position(3.0, 0.0, 1.0), brake=False)


def test_within_the_grace_the_old_goal_is_resumed():
    latch = stopped_before_its_goal()
    latch.resumed()
    assert latch.accepts(GOAL, brake=False)


def test_another_goal_is_accepted_and_unlocks_the_old_one():
    latch = stopped_before_its_goal()
    assert latch.accepts(OTHER_GOAL, brake=False)
    assert latch.accepts(GOAL, brake=False)


def test_a_brake_command_unlocks_the_old_goal():
    latch = stopped_before_its_goal()
    assert latch.accepts(GOAL, brake=True)
    assert latch.accepts(GOAL, brake=False)


def test_a_stop_without_a_goal_locks_no_goal():
    latch = GoalLatch()
    latch.stopped()
    assert latch.accepts(GOAL, brake=False)
    assert latch.accepts(GOAL, brake=True)
    latch.stopped()
    assert latch.accepts(GOAL, brake=False)
