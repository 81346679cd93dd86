"""Our messages as those of ROS: SI units, frames as in REP 103 and 105. Pure.

The world is the frame `map` (ENU), the body of a vehicle is `VEHICLE/base_link` (FLU).
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Duration as Duration,
    builtin_interfaces__msg__Time as Time,
    geometry_msgs__msg__Point as Point,
    geometry_msgs__msg__Pose as RosPose,
    geometry_msgs__msg__PoseStamped as PoseStamped,
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
    geometry_msgs__msg__Quaternion as RosQuaternion,
    geometry_msgs__msg__Transform as Transform,
    geometry_msgs__msg__TransformStamped as TransformStamped,
    geometry_msgs__msg__Twist as Twist,
    geometry_msgs__msg__TwistWithCovariance as TwistWithCovariance,
    geometry_msgs__msg__Vector3 as Vector3,
    nav_msgs__msg__Odometry as Odometry,
    sensor_msgs__msg__CompressedImage as CompressedImage,
    sensor_msgs__msg__FluidPressure as FluidPressure,
    std_msgs__msg__ColorRGBA as ColorRGBA,
    std_msgs__msg__Header as Header,
    std_msgs__msg__String as String,
    tf2_msgs__msg__TFMessage as TFMessage,
    visualization_msgs__msg__Marker as Marker,
    visualization_msgs__msg__MarkerArray as MarkerArray,
    visualization_msgs__msg__MeshFile as MeshFile,
)

from quadctl.schemas.earth import WORLD
from quadctl.schemas.messages import Pose, Pressure, SafetyState, Velocity
from quadctl.services.runtime.recording.scene import Color, Placed, SceneEntity, SceneUpdate

_UNKNOWN = np.zeros(36)
"""Covariance of 6 x 6 that is not known."""
_CUBE, _SPHERE, _CYLINDER, _LINE_LIST = 1, 2, 3, 5
"""Types of markers."""
_ADD, _DELETE_ALL = 0, 3
"""Actions of markers."""
_LINE = 0.03
"""Width of a line, m."""


def time_of(nanoseconds: int) -> Time:
    """Return a time given in ns since the epoch of its clock."""
    return Time(*divmod(nanoseconds, 1_000_000_000))


def body_frame(vehicle: str) -> str:
    """Return the name of a vehicle's body frame."""
    return f"{vehicle}/base_link"


def pose_stamped(pose: Pose, stamp: Time) -> PoseStamped:
    """Return a pose in the world."""
    return PoseStamped(Header(stamp, WORLD), _placed(pose))


def transform(pose: Pose, stamp: Time, vehicle: str) -> TFMessage:
    """Return a pose as the transform from the world to the body."""
    at, turned = pose.position, _turned(pose)
    shift = Transform(Vector3(at.x, at.y, at.z), turned)
    return TFMessage([TransformStamped(Header(stamp, WORLD), body_frame(vehicle), shift)])


def odometry(pose: Pose, stamp: Time, vehicle: str) -> Odometry:
    """Return pose and velocities; ROS has these in the body frame."""
    rates = pose.body_rates
    twist = Twist(_in_body(pose.velocity, pose), Vector3(rates.x, rates.y, rates.z))
    return Odometry(
        Header(stamp, WORLD),
        body_frame(vehicle),
        PoseWithCovariance(_placed(pose), _UNKNOWN),
        TwistWithCovariance(twist, _UNKNOWN),
    )


def _placed(pose: Pose | Placed) -> RosPose:
    at = pose.position
    return RosPose(Point(at.x, at.y, at.z), _turned(pose))


def _turned(pose: Pose | Placed) -> RosQuaternion:
    q = pose.orientation
    return RosQuaternion(q.x, q.y, q.z, q.w)


def _in_body(velocity: Velocity, pose: Pose) -> Vector3:
    """Return a velocity of the world in the body frame: turned by the conjugate quaternion."""
    w, x, y, z = (getattr(pose.orientation, name) for name in "wxyz")
    vx, vy, vz = velocity.x, velocity.y, velocity.z
    tx, ty, tz = 2 * (vy * z - vz * y), 2 * (vz * x - vx * z), 2 * (vx * y - vy * x)
    return Vector3(
        vx + w * tx + (ty * z - tz * y),
        vy + w * ty + (tz * x - tx * z),
        vz + w * tz + (tx * y - ty * x),
    )


def fluid_pressure(reading: Pressure, stamp: Time, vehicle: str) -> FluidPressure:
    """Return the absolute pressure (Pa) with an unknown variance: ours is in hPa, less its baseline."""
    absolute = 100.0 * (reading.pressure + reading.baseline)
    return FluidPressure(Header(stamp, body_frame(vehicle)), absolute, 0.0)


def state_text(state: SafetyState) -> String:
    """Return the state, and after a colon its reason, if it has one."""
    return String(f"{state.state}: {state.reason}" if state.reason else state.state)


def markers(scene: SceneUpdate, stamp: Time, vehicle: str) -> MarkerArray:
    """Return a whole scene, in the place of everything that was shown before."""
    blank, colour = Placed(), Color(0.0, 0.0, 0.0, 0.0)
    nothing = Vector3(0.0, 0.0, 0.0)
    found: list[Any] = [
        _marker(Header(stamp, WORLD), "", 0, _CUBE, _DELETE_ALL, blank, nothing, colour, [])
    ]
    for entity in scene.entities:
        own = entity.frame_id == vehicle
        header = Header(stamp, body_frame(vehicle) if own else entity.frame_id)
        for number, (type_, pose, size, color, points) in enumerate(_shapes(entity)):
            found.append(_marker(header, entity.id, number, type_, _ADD, pose, size, color, points))
    return MarkerArray(found)


def _shapes(entity: SceneEntity) -> Iterator[tuple[int, Placed, Vector3, Color, list[Any]]]:
    """Yield type, pose, size, colour and points of each shape."""
    solids = (_CUBE, entity.cubes), (_SPHERE, entity.spheres), (_CYLINDER, entity.cylinders)
    for type_, shapes in solids:
        for shape in shapes:
            size = shape.size
            yield type_, shape.pose, Vector3(size.x, size.y, size.z), shape.color, []
    for line in entity.lines:
        yield _LINE_LIST, line.pose, Vector3(_LINE, 0.0, 0.0), line.color, line.points


def _marker(
    header: Header, name: str, number: int, type_: int, action: int, pose: Placed, size: Vector3,
    colour: Color, points: list[Any],
) -> Marker:  # fmt: skip
    no_bytes = np.zeros(0, np.uint8)
    return Marker(
        header, name, number, type_, action, _placed(pose), size,
        ColorRGBA(colour.r, colour.g, colour.b, colour.a), Duration(0, 0), header.frame_id != WORLD,
        [Point(each.x, each.y, each.z) for each in points], [], "",
        CompressedImage(header, "", no_bytes), [], "", "", MeshFile("", no_bytes), False,
    )  # fmt: skip
