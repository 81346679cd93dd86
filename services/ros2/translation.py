"""Our messages as those of ROS: SI units, frames as in REP 103 and 105.

The world is the frame `map` (ENU), the body of a vehicle is `VEHICLE/base_link` (FLU).
"""

import math
from collections.abc import Sequence

from quadctl.schemas.earth import WORLD
from quadctl.schemas.messages import CageSize, Pose, Pressure, SafetyState, Velocity, Zone
from quadctl.schemas.services import GotoRequest
from quadctl.schemas.zones import edges_of
from quadctl.services.ros2.cdr import Malformed
from quadctl.services.ros2.messages import (
    Colour,
    FluidPressure,
    Header,
    Marker,
    MarkerArray,
    Odometry,
    Orientation,
    PlainPose,
    PoseStamped,
    PoseWithCovariance,
    RosTime,
    String,
    TFMessage,
    Transform,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector,
)

_LINE_LIST, _ADD, _DELETE = 5, 0, 2
_LINE = 0.03
"""Width of a line in m."""
_ROUND = 32
"""Corners of a circle."""
_CAGE = Colour(1.0, 0.6, 0.0, 1.0)
_EXCLUSION = Colour(1.0, 0.1, 0.1, 1.0)
_INCLUSION = Colour(0.1, 0.8, 0.2, 1.0)
_OFF = 0.15
"""Opacity of bounds that are not in force."""

_MOST_SHOWN = 64
"""Characters of a foreign text in our log."""

Place = tuple[float, float]


def time_of(nanoseconds: int) -> RosTime:
    """Return a time given in ns since the epoch of its clock."""
    return RosTime(*divmod(nanoseconds, 1_000_000_000))


def body_frame(vehicle: str) -> str:
    """Return the name of a vehicle's body frame."""
    return f"{vehicle}/base_link"


def pose_stamped(pose: Pose, stamp: RosTime) -> PoseStamped:
    """Return a pose in the world."""
    return PoseStamped(Header(stamp, WORLD), _plain(pose))


def transform(pose: Pose, stamp: RosTime, vehicle: str) -> TFMessage:
    """Return a pose as the transform from the world to the body."""
    plain = _plain(pose)
    return TFMessage(
        (
            TransformStamped(
                Header(stamp, WORLD),
                body_frame(vehicle),
                Transform(plain.position, plain.orientation),
            ),
        )
    )


def odometry(pose: Pose, stamp: RosTime, vehicle: str) -> Odometry:
    """Return pose and velocities; ROS has these in the body frame."""
    rates = pose.body_rates
    return Odometry(
        Header(stamp, WORLD),
        body_frame(vehicle),
        PoseWithCovariance(_plain(pose)),
        TwistWithCovariance(
            Twist(_in_body(pose.velocity, pose), Vector(rates.x, rates.y, rates.z))
        ),
    )


def _plain(pose: Pose) -> PlainPose:
    at, turned = pose.position, pose.orientation
    return PlainPose(Vector(at.x, at.y, at.z), Orientation(turned.x, turned.y, turned.z, turned.w))


def _in_body(velocity: Velocity, pose: Pose) -> Vector:
    """Return a velocity of the world in the body frame: turned by the conjugate quaternion."""
    w, x, y, z = (getattr(pose.orientation, name) for name in "wxyz")
    vx, vy, vz = velocity.x, velocity.y, velocity.z
    tx, ty, tz = 2 * (vy * z - vz * y), 2 * (vz * x - vx * z), 2 * (vx * y - vy * x)
    return Vector(
        vx + w * tx + (ty * z - tz * y),
        vy + w * ty + (tz * x - tx * z),
        vz + w * tz + (tx * y - ty * x),
    )


def goal_of(goal: PoseStamped, height: float | None) -> GotoRequest:
    """Return the request to fly to a goal, in place of the present one; raise Malformed.

    The tool of RViz points at the ground: a goal of height 0 means `height` (m), if that is known
    yet.
    """
    frame, at = goal.header.frame_id, goal.pose.position
    if frame not in {"", WORLD}:
        raise Malformed(f"its frame is {frame[:_MOST_SHOWN]}, not {WORLD}")
    if not all(map(math.isfinite, (at.x, at.y, at.z))):
        raise Malformed("it is not finite")
    if not at.z and height is None:
        raise Malformed("it is on the ground, and the present height is not known yet")
    return GotoRequest(at.x, at.y, at.z or height or 0.0, replace=True)


def fluid_pressure(reading: Pressure, stamp: RosTime, vehicle: str) -> FluidPressure:
    """Return the absolute pressure, Pa: the reading is hPa, its baseline subtracted."""
    absolute = 100.0 * (reading.pressure + reading.baseline)
    return FluidPressure(Header(stamp, body_frame(vehicle)), absolute)


def state_text(state: SafetyState) -> String:
    """Return the state, and after a colon its reason, if it has one."""
    return String(f"{state.state}: {state.reason}" if state.reason else state.state)


def bounds(
    state: SafetyState, zones: tuple[Zone, ...], gone: set[str], stamp: RosTime
) -> MarkerArray:
    """Return the edges of the cage and the zones, pale while the cage is off.

    `gone` are the names of zones shown before, which a viewer must remove.
    """
    header = Header(stamp, WORLD)
    box = _prism(_box(state.cage), 0.0, state.cage.z)
    shapes = [("cage", box, _CAGE)]
    for zone in zones:
        # A zone without floor or ceiling is drawn from the ground to the height of the cage.
        floor = max(zone.floor, 0.0)
        ceiling = min(zone.ceiling, max(state.cage.z, floor))
        colour = _EXCLUSION if zone.kind == "exclusion" else _INCLUSION
        shapes.append((f"zone {zone.name}", _prism(_outline(zone), floor, ceiling), colour))
    opacity = 1.0 if state.cage_on else _OFF
    drawn = [
        Marker(
            header, name, 0, _LINE_LIST, _ADD, scale=Vector(x=_LINE),
            color=Colour(colour.r, colour.g, colour.b, opacity), points=points,
        )
        for name, points, colour in shapes
    ]  # fmt: skip
    removed = [Marker(header, f"zone {name}", 0, _LINE_LIST, _DELETE) for name in sorted(gone)]
    return MarkerArray((*drawn, *removed))


def _box(cage: CageSize) -> list[Place]:
    x, y = cage.x, cage.y
    return [(-x, -y), (x, -y), (x, y), (-x, y)]


def _outline(zone: Zone) -> Sequence[Place]:
    if zone.corners:
        return zone.polygon
    circle = zone.circle
    angles = [2 * math.pi * n / _ROUND for n in range(_ROUND)]
    return [
        (circle.x + circle.radius * math.cos(angle), circle.y + circle.radius * math.sin(angle))
        for angle in angles
    ]


def _prism(outline: Sequence[Place], floor: float, ceiling: float) -> tuple[Vector, ...]:
    """Return the ends of all edges of a column, in pairs."""
    ends: list[Vector] = []
    for ax, ay, bx, by in edges_of(outline):
        for z in (floor, ceiling):
            ends += [Vector(ax, ay, z), Vector(bx, by, z)]
        ends += [Vector(ax, ay, floor), Vector(ax, ay, ceiling)]
    return tuple(ends)
