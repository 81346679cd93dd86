"""Faulty poses, weak motors, and the setpoints that a vehicle accepts after a stop."""

import time
from math import dist
from typing import cast

import pytest
from msgspec import structs

from quadctl.schemas.messages import BodyRates, Pose, Position, Quaternion, Setpoint, Velocity
from quadctl.schemas.params import DynamicsParams, FlightFaultParams, Params
from quadctl.schemas.topics import POSE, POSE_SLOW, SETPOINT
from quadctl.services.dynamics.faulty_pose import FaultyPose
from quadctl.services.dynamics.simulation import Simulation
from quadctl.services.dynamics.vehicle import Vehicle
from quadctl.services.runtime.goal_latch import GoalLatch
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.testing import FakeNode, FakePublisher


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


class Blown:
    """Vehicle in the air, with setpoints to one goal until another is set."""

    def __init__(self, *, lockstep: bool = False) -> None:
        self.params = Params()
        self.params.dynamics.start.z = 1.0
        self.params.dynamics.lockstep = lockstep
        self.node = FakeNode("dynamics", self.params, [], [])
        self.simulation = Simulation(cast("Node", self.node), self.params)
        self.vehicle = self.simulation.vehicle
        self.goal = Position(0.0, 0.0, 1.5)

    def fly(self, seconds: float) -> None:
        for count in range(round(100 * seconds)):
            if count % 5 == 0:
                boot = self.simulation._boot
                setpoint = Setpoint(boot, count, self.goal, brake=False)
                self.node._listeners[SETPOINT.name].take(setpoint)
            self.simulation.tick(time.monotonic())


def test_a_setpoint_to_brake_just_before_the_same_goal_changes_no_flight():
    """Safety sends both for a goal that is requested again: the vehicle may have stopped by itself."""
    states = []
    for brakes in (False, True):
        blown = Blown()
        blown.fly(0.5)
        if brakes:
            stop = Setpoint(blown.simulation._boot, 49, blown.goal, brake=True)
            blown.node._listeners[SETPOINT.name].take(stop)
        blown.fly(1.0)
        states.append(blown.vehicle.state)
    assert states[0] == states[1]


@pytest.mark.parametrize("is_known", [True, False])
def test_a_vehicle_that_cannot_hold_itself_lands_until_it_can(is_known: bool):
    blown = Blown()
    blown.fly(2.0)
    if is_known:
        blown.params.dynamics.wind.mean.x = 10.0
        blown.simulation.configure()
    else:
        blown.vehicle._air = (11.0, 0.0, 0.0, *blown.vehicle._air[3:])
    blown.fly(6.0)
    landed = blown.vehicle.position
    assert blown.vehicle.standing
    assert 0 < landed[0] < 8
    if is_known:
        # A goal requested in that wind is void for good.
        blown.goal = Position(1.0, 0.0, 1.0)
    blown.fly(1.0)
    assert blown.vehicle.position == landed
    blown.params.dynamics.wind.mean.x = 0.0
    blown.vehicle._air = (0.0, 0.0, 0.0, *blown.vehicle._air[3:])
    blown.simulation.configure()
    # Safety may accept a goal before the next pose: it must not be void.
    blown.goal = Position(2.0, 0.0, 1.0)
    blown.fly(9.0)
    assert dist(blown.vehicle.position, (2.0, 0.0, 1.0)) < 0.01


def test_limits_that_follow_from_a_wind_wait_for_a_standstill():
    blown = Blown()
    blown.goal = Position(4.0, 0.0, 1.5)
    blown.fly(0.5)
    limits = blown.vehicle.constants[3]
    blown.params.dynamics.wind.mean.x = -6.0
    blown.simulation.configure()
    assert blown.vehicle.constants[3] == limits
    blown.fly(8.0)
    assert blown.vehicle.constants[3][1] < limits[1]
    assert dist(blown.vehicle.position, (4.0, 0.0, 1.5)) < 0.01


@pytest.mark.parametrize("late", [0.001, 0.012, 0.049, 0.051])
def test_a_tick_for_several_poses_flies_as_a_tick_for_each(late: float):
    """Setpoints take effect at the same poses, and so does their absence."""
    flown = []
    for watched in (True, False):
        blown = Blown()
        blown.params.dynamics.wind.gust = 1.0
        simulation, start = blown.simulation, 1000.0
        cast("FakePublisher", simulation.poses).has_subscribers = watched
        simulation.boot("same")
        simulation.publish()
        assert simulation.tick_rate() == (100 if watched else 20)
        now = start
        for count in range(900):
            # Goals, a silence beyond the time-out in flight, and a new goal.
            if count % 5 == 0 and not 530 <= count < 570:
                goal = Position(1.1 + count // 500 + count // 600, 0.0, 1.5)
                setpoint = Setpoint("same", count, goal, brake=False)
                simulation._arrived.append((start + count / 100 + late, setpoint))
            if count == 30:
                # It waits until the vehicle stands still, at this goal.
                blown.params.dynamics.vehicle.mass *= 1.1
                simulation.configure()
            if (count + 1) % 5 == 0 or watched:
                now = start + (count + 1) / 100
                simulation.tick_rate()
                simulation.tick(now)
        published = [m for topic, m in blown.node.published if topic == POSE_SLOW.name]
        assert len(published) == 1 + 900 / 5
        flown.append((simulation.vehicle.state, published))
    assert flown[0] == flown[1]


@pytest.mark.parametrize("lockstep", [False, True])
def test_poses_without_a_subscriber_are_published_in_lockstep_only(lockstep: bool):
    blown = Blown(lockstep=lockstep)
    simulation = blown.simulation
    cast("FakePublisher", simulation.poses).has_subscribers = False
    blown.node.published.clear()
    simulation.publish()
    assert sum(topic == POSE.name for topic, _ in blown.node.published) == lockstep


def test_a_tick_flies_several_poses_only_between_two_answers_and_in_real_time():
    blown = Blown()
    simulation = blown.simulation
    publisher = cast("FakePublisher", simulation.poses)
    publisher.has_subscribers = False
    assert simulation.tick_rate() == 20
    publisher.has_subscribers = True
    assert simulation.tick_rate() == 100
    simulation.tick(1.0)
    publisher.has_subscribers = False
    assert simulation.tick_rate() == 100
    for _ in range(4):
        simulation.tick(1.0)
    assert simulation.tick_rate() == 20
    blown.params.dynamics.rate = 25.0
    assert simulation.tick_rate() == 25
    stepped = Blown(lockstep=True).simulation
    cast("FakePublisher", stepped.poses).has_subscribers = False
    assert stepped.tick_rate() == 100
