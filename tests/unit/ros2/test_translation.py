"""Our messages as those of ROS: frames, units and shapes."""

from math import cos, inf, nan, sin

import pytest

from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Pressure,
    Quaternion,
    SafetyState,
    Velocity,
    Zone,
)
from quadctl.schemas.services import GotoRequest
from quadctl.schemas.zones import FARTHEST, CircleParams, ZoneParams
from quadctl.services.ros2 import translation
from quadctl.services.ros2.cdr import Malformed
from quadctl.services.ros2.messages import Header, PlainPose, PoseStamped, RosTime, Vector

STAMP = RosTime(12, 500)
QUARTER = Quaternion(cos(0.25 * 3.141592653589793), 0.0, 0.0, sin(0.25 * 3.141592653589793))
POSE = Pose(
    "boot", 1, 2.0, Position(1.0, 2.0, 3.0), Velocity(0.0, 1.5, 0.5), QUARTER,
    BodyRates(0.1, 0.2, 0.3),
)  # fmt: skip
STATE = SafetyState(
    "boot", 1.0, 1, "HOVERING", Position(0, 0, 1), cage_on=True, cage=CageSize(5, 4, 3), reason=""
)
TOWER = Zone.of(
    ZoneParams("tower", polygon=((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)), ceiling=2.0)
)
ROUND = Zone.of(ZoneParams("round", "inclusion", circle=CircleParams(0.0, 0.0, 2.0)))


def test_nanoseconds_become_seconds_and_the_rest():
    assert translation.time_of(12_000_000_500) == STAMP


def test_a_pose_is_in_the_frame_map():
    found = translation.pose_stamped(POSE, STAMP)
    assert (found.header.stamp, found.header.frame_id) == (STAMP, "map")
    assert found.pose.position == Vector(1.0, 2.0, 3.0)
    assert found.pose.orientation.w == pytest.approx(QUARTER.w)


def test_a_transform_leads_from_map_to_the_body():
    (found,) = translation.transform(POSE, STAMP, "uav1").transforms
    assert (found.header.frame_id, found.child_frame_id) == ("map", "uav1/base_link")
    assert found.transform.translation == Vector(1.0, 2.0, 3.0)


def test_odometry_has_the_velocity_in_the_body_frame():
    twist = translation.odometry(POSE, STAMP, "uav").twist.twist
    # Turned left by 90 degrees, north is ahead.
    assert (twist.linear.x, twist.linear.y) == (pytest.approx(1.5), pytest.approx(0.0))
    assert twist.linear.z == pytest.approx(0.5)
    assert twist.angular == Vector(0.1, 0.2, 0.3)


def test_pressure_is_absolute_and_in_pascals():
    reading = Pressure(1.0, -0.12, 1013.25, 10, 0.01)
    assert translation.fluid_pressure(reading, STAMP, "uav").fluid_pressure == pytest.approx(101313)


def test_a_reason_follows_the_state():
    assert translation.state_text(STATE).data == "HOVERING"


def test_the_cage_has_twelve_edges():
    (cage,) = translation.bounds(STATE, (), set(), STAMP).markers
    assert (cage.ns, cage.type, cage.action, cage.color.a) == ("cage", 5, 0, 1.0)
    edges = {frozenset([a, b]) for a, b in zip(cage.points[::2], cage.points[1::2], strict=True)}
    assert len(edges) == 12
    assert {(abs(p.x), abs(p.y)) for p in cage.points} == {(5, 4)}
    assert {p.z for p in cage.points} == {0, 3}


def test_zones_are_drawn_between_the_ground_and_the_top_of_the_cage():
    _, tower, round_ = translation.bounds(STATE, (TOWER, ROUND), set(), STAMP).markers
    assert {point.z for point in tower.points} == {0, 2}
    assert ROUND.ceiling == FARTHEST
    assert {point.z for point in round_.points} == {0, 3}
    assert all(p.x**2 + p.y**2 == pytest.approx(4) for p in round_.points)


def test_a_zone_that_is_gone_is_removed():
    _, gone = translation.bounds(STATE, (), {"tower"}, STAMP).markers
    assert (gone.ns, gone.action) == ("zone tower", 2)


def goal(x: float, y: float, z: float, frame: str = "map") -> PoseStamped:
    return PoseStamped(Header(frame_id=frame), PlainPose(Vector(x, y, z)))


@pytest.mark.parametrize("frame", ["", "map"])
def test_a_goal_replaces_the_present_one(frame):
    found = translation.goal_of(goal(1.0, 2.0, 3.0, frame), 9.0)
    assert found == GotoRequest(1.0, 2.0, 3.0, replace=True)


def test_a_goal_on_the_ground_means_the_present_height():
    assert translation.goal_of(goal(1.0, 2.0, 0.0), 1.5).z == 1.5


@pytest.mark.parametrize(
    "bad", [goal(1.0, 1.0, 1.0, "odom"), goal(nan, 1.0, 1.0), goal(1.0, inf, 1.0)]
)
def test_a_goal_of_another_frame_or_without_a_place_is_refused(bad):
    with pytest.raises(Malformed):
        translation.goal_of(bad, 1.0)
