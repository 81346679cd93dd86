"""Our messages as those of ROS: frames, units and shapes."""

from math import cos, sin
from typing import Any

import pytest
from msgspec import structs
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__Point as Point,
    geometry_msgs__msg__Vector3 as Vector3,
)

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
    Zones,
)
from quadctl.schemas.zones import FARTHEST, CircleParams, ZoneParams
from quadctl.services.bridges.ros2 import translation
from quadctl.services.runtime.recording.scene import Drawing

STAMP = Time(12, 500)
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
    assert found.pose.position == Point(1.0, 2.0, 3.0)
    assert found.pose.orientation.w == pytest.approx(QUARTER.w)


def test_a_transform_leads_from_map_to_the_body():
    (found,) = translation.transform(POSE, STAMP, "uav1").transforms
    assert (found.header.frame_id, found.child_frame_id) == ("map", "uav1/base_link")
    assert found.transform.translation == Vector3(1.0, 2.0, 3.0)


def test_odometry_has_the_velocity_in_the_body_frame():
    twist = translation.odometry(POSE, STAMP, "uav").twist.twist
    # Turned left by 90 degrees, north is ahead.
    assert (twist.linear.x, twist.linear.y) == (pytest.approx(1.5), pytest.approx(0.0))
    assert twist.linear.z == pytest.approx(0.5)
    assert twist.angular == Vector3(0.1, 0.2, 0.3)


def test_pressure_is_absolute_and_in_pascals():
    reading = Pressure(1.0, -0.12, 1013.25, 10, 0.01)
    assert translation.fluid_pressure(reading, STAMP, "uav").fluid_pressure == pytest.approx(101313)


def test_a_reason_follows_the_state():
    assert translation.state_text(STATE).data == "HOVERING"


def shown(*zones: Zone, cage_on: bool = True):
    """Return the markers of a scene by their names."""
    drawing = Drawing("uav")
    drawing.derive("", Zones(zones), 0)
    drawing.derive("", structs.replace(STATE, cage_on=cage_on), 0)
    scene = drawing.whole(0)
    assert scene is not None
    first, *found = translation.markers(scene, STAMP, "uav").markers
    assert first.action == 3  # everything that was shown before is deleted
    by_name: dict[str, list[Any]] = {}
    for each in found:
        by_name.setdefault(each.ns, []).append(each)
    return by_name


def test_the_cage_has_twelve_edges_and_is_pale_while_it_is_off():
    (cage,) = shown()["uav/cage"]
    assert (cage.type, cage.action, cage.header.frame_id) == (5, 0, "map")
    edges = {
        frozenset([(a.x, a.y, a.z), (b.x, b.y, b.z)])
        for a, b in zip(cage.points[::2], cage.points[1::2], strict=True)
    }
    assert len(edges) == 12
    assert {(abs(p.x), abs(p.y)) for p in cage.points} == {(5, 4)}
    assert {p.z for p in cage.points} == {0, 3}
    (off,) = shown(cage_on=False)["uav/cage"]
    assert off.color.a < cage.color.a


def test_zones_are_drawn_between_the_ground_and_the_top_of_the_cage():
    found = shown(TOWER, ROUND)
    ((tower,), (column,)) = found["uav/zone/tower"], found["uav/zone/round"]
    assert {point.z for point in tower.points} == {0, 2}
    assert ROUND.ceiling == FARTHEST
    assert (column.type, column.scale) == (3, Vector3(4.0, 4.0, 3.0))
    assert column.pose.position == Point(0.0, 0.0, 1.5)


def test_the_body_is_drawn_in_its_own_frame_and_the_goal_where_it_is():
    found = shown()
    assert {each.header.frame_id for each in found["uav/body"]} == {"uav/base_link"}
    assert len({each.id for each in found["uav/body"]}) == 3
    (goal,) = found["uav/goal"]
    assert (goal.type, goal.pose.position) == (2, Point(0, 0, 1))
