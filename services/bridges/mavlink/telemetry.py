"""Telemetry of a vehicle in the form of PX4's, from our poses and states. Pure.

Our world is ENU with bodies FLU; MAVLink has NED with bodies FRD.
"""

import struct
from math import asin, atan2, cos, degrees, hypot, sin, sqrt
from typing import Any

from msgspec import Struct
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import Origin
from quadctl.schemas.messages import Pose, Quaternion

HOLD, MISSION, RETURN, LAND, TAKEOFF = (4 << 16 | sub << 24 for sub in (3, 4, 5, 6, 2))
"""Modes of PX4 in its `custom_mode`: all are sub-modes of AUTO."""
OFFBOARD = 6 << 16
"""Mode of PX4 in which it flies to the setpoints of a program."""
NO_PLACE = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
NO_VELOCITY = (
    mavlink.POSITION_TARGET_TYPEMASK_VX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VZ_IGNORE
)
"""Bits of a setpoint that has no place, or no velocity."""
_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
_MODE = (
    mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    | mavlink.MAV_MODE_FLAG_AUTO_ENABLED
    | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
)
CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_GEOFENCE
    | mavlink.MAV_SYS_STATUS_PREARM_CHECK
)
_OPEN, _NAK = 4, 129
"""Commands of MAVLink's file transfer."""
_UNKNOWN = 0xFFFF
_IN_AIR = 0.1
"""Height (m) above which a vehicle flies."""


class View(Struct, frozen=True):
    """Vehicle in the eyes of ground stations. Without a fresh pose it is not `healthy`.

    `mission` has the next item, the number of items and the state, MISSION_STATE.
    """

    pose: Pose
    origin: Origin
    home: tuple[float, float]
    mode: int
    armed: bool
    healthy: bool
    mission: tuple[int, int, int]
    lands: bool = False

    @property
    def _boot_ms(self) -> int:
        return round(self.pose.stamp * 1000) & 0xFFFFFFFF

    def heartbeat(self) -> Any:
        """Return the sign of life, with mode and arming."""
        active = mavlink.MAV_STATE_ACTIVE if self.armed else mavlink.MAV_STATE_STANDBY
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_PX4,
            _MODE | (_ARMED if self.armed else 0),
            self.mode,
            active if self.healthy else mavlink.MAV_STATE_CRITICAL,
            3,
        )

    def sys_status(self) -> Any:
        """Return the health of the sensors; the battery is unknown."""
        healthy = _SENSORS if self.healthy else _SENSORS & ~mavlink.MAV_SYS_STATUS_PREARM_CHECK
        return mavlink.MAVLink_sys_status_message(
            _SENSORS, _SENSORS, healthy, 0, _UNKNOWN, -1, -1, 0, 0, 0, 0, 0, 0
        )

    def global_position_int(self) -> Any:
        """Return place and velocity on the earth: 1e-7 degrees, mm, cm/s."""
        p, v = self.pose.position, self.pose.velocity
        return mavlink.MAVLink_global_position_int_message(
            self._boot_ms,
            *self._on_earth(p.x, p.y, p.z),
            round(p.z * 1000),
            _short(100 * v.y),
            _short(100 * v.x),
            _short(-100 * v.z),
            round(self._heading * 100) % 36_000,
        )

    def local_position_ned(self) -> Any:
        """Return place and velocity in the world, m and m/s, NED."""
        p, v = self.pose.position, self.pose.velocity
        return mavlink.MAVLink_local_position_ned_message(
            self._boot_ms, p.y, p.x, -p.z, v.y, v.x, -v.z
        )

    def attitude_quaternion(self) -> Any:
        """Return the rotation from the world (NED) to the body (FRD), and its rates, rad/s."""
        q, r = attitude(self.pose.orientation), self.pose.body_rates
        return mavlink.MAVLink_attitude_quaternion_message(
            self._boot_ms, q.w, q.x, q.y, q.z, r.x, -r.y, -r.z
        )

    def attitude(self) -> Any:
        """Return roll, pitch, yaw (rad) and their rates, rad/s."""
        roll, pitch, yaw = _angles(attitude(self.pose.orientation))
        r = self.pose.body_rates
        return mavlink.MAVLink_attitude_message(self._boot_ms, roll, pitch, yaw, r.x, -r.y, -r.z)

    def gps_raw_int(self) -> Any:
        """Return the place like a receiver of satellites: 1e-7 degrees, mm, cm/s."""
        p, v = self.pose.position, self.pose.velocity
        return mavlink.MAVLink_gps_raw_int_message(
            round(self.pose.stamp * 1e6),
            mavlink.GPS_FIX_TYPE_3D_FIX,
            *self._on_earth(p.x, p.y, p.z),
            50,
            50,
            min(round(100 * hypot(v.x, v.y)), 0xFFFE),
            round(degrees(atan2(v.x, v.y)) * 100) % 36_000,
            12,
        )

    def extended_sys_state(self) -> Any:
        """Return whether the vehicle is on the ground."""
        state = mavlink.MAV_LANDED_STATE_ON_GROUND
        if flies(self.pose):
            state = mavlink.MAV_LANDED_STATE_IN_AIR
            if self.lands:
                state = mavlink.MAV_LANDED_STATE_LANDING
            elif self.mode == TAKEOFF:
                state = mavlink.MAV_LANDED_STATE_TAKEOFF
        return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, state)

    def home_position(self) -> Any:
        """Return the place on the ground to which the vehicle returns."""
        x, y = self.home
        return mavlink.MAVLink_home_position_message(
            *self._on_earth(x, y, 0.0), y, x, 0.0, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0
        )

    def gps_global_origin(self) -> Any:
        """Return the place on the earth of the world's origin."""
        return mavlink.MAVLink_gps_global_origin_message(*self._on_earth(0.0, 0.0, 0.0))

    def mission_current(self) -> Any:
        """Return the progress of the mission."""
        return mavlink.MAVLink_mission_current_message(*self.mission)

    def vfr_hud(self) -> Any:
        """Return speed (m/s), heading and height, m."""
        p, v = self.pose.position, self.pose.velocity
        ground = hypot(v.x, v.y)
        return mavlink.MAVLink_vfr_hud_message(
            sqrt(ground * ground + v.z * v.z),
            ground,
            round(self._heading) % 360,
            50 if flies(self.pose) else 0,
            self.origin.altitude + p.z,
            v.z,
        )

    def autopilot_version(self) -> Any:
        """Return the capabilities; ground stations take the version for PX4's, here 1.16.0."""
        release = 1 << 24 | 16 << 16 | 255
        none = [0] * 8
        return mavlink.MAVLink_autopilot_version_message(
            CAPABILITIES, release, 0, 0, 0, none, none, none, 0, 0, 0
        )

    def _on_earth(self, x: float, y: float, z: float) -> tuple[int, int, int]:
        """Return latitude, longitude (1e-7 degrees) and height above sea level (mm) of a place."""
        return *self.origin.to_earth(x, y), round((self.origin.altitude + z) * 1000)

    @property
    def _heading(self) -> float:
        """Return the direction of the nose, degrees from north to east."""
        return degrees(_angles(attitude(self.pose.orientation))[2]) % 360


def flies(pose: Pose) -> bool:
    """Return whether a vehicle is in the air."""
    return pose.position.z > _IN_AIR


def attitude(q: Quaternion) -> Quaternion:
    """Return the rotation from NED to FRD of one from FLU to ENU."""
    # q_ned = (x and y exchanged, z reversed) * q * (y and z reversed).
    root = sqrt(0.5)
    w, x, y, z = q.w, q.x, q.y, q.z
    return Quaternion(root * (w + z), root * (x + y), root * (x - y), root * (w - z))


def _angles(q: Quaternion) -> tuple[float, float, float]:
    roll = atan2(2 * (q.w * q.x + q.y * q.z), 1 - 2 * (q.x * q.x + q.y * q.y))
    pitch = asin(min(max(2 * (q.w * q.y - q.z * q.x), -1.0), 1.0))
    yaw = atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    return roll, pitch, yaw


def turned(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the rotation of roll, pitch and yaw, rad."""
    (a, b), (c, d), (e, f) = ((cos(x / 2), sin(x / 2)) for x in (roll, pitch, yaw))
    return Quaternion(
        a * c * e + b * d * f, b * c * e - a * d * f, a * d * e + b * c * f, a * c * f - b * d * e
    )


def _short(number: float) -> int:
    return min(max(round(number), -32_768), 32_767)


def texts(text: str, severity: int = mavlink.MAV_SEVERITY_WARNING, number: int = 0) -> list[Any]:
    """Return the messages that show a text; those of a long one have the same `number`, not 0."""
    data = text.encode()
    return [
        mavlink.MAVLink_statustext_message(
            severity, data[start : start + 50], number if len(data) > 50 else 0, start // 50
        )
        # A chunk that is not full ends a long text.
        for start in range(0, len(data) + (len(data) > 50), 50)
    ]


def no_file(request: Any, peer: tuple[int, int]) -> Any:
    """Return the answer to a request for a file: there is none, and no command for files."""
    # QGroundControl looks for a file of parameters first, and waits for an answer.
    number, session, command = struct.unpack_from("<HBB", bytes(request.payload))
    error = 10 if command == _OPEN else 7
    head = struct.pack(
        "<HBBBBBBIB", (number + 1) & 0xFFFF, session, _NAK, 1, command, 0, 0, 0, error
    )
    return mavlink.MAVLink_file_transfer_protocol_message(0, *peer, [*head.ljust(251, b"\0")])
