"""Telemetry of a vehicle as a PX4 sends it, from our poses and states. Pure.

Our world is ENU with bodies FLU; MAVLink has NED with bodies FRD.
"""

from math import asin, atan2, degrees, hypot, sqrt
from typing import Any

from msgspec import Struct
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.messages import Pose, Quaternion
from quadctl.services.mavlink.geo import Origin

HOLD, MISSION, RETURN, LAND, TAKEOFF = (4 << 16 | sub << 24 for sub in (3, 4, 5, 6, 2))
"""Modes of PX4 in its `custom_mode`: all are sub-modes of AUTO."""
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
_UNKNOWN = {"u16": 0xFFFF, "u8": 0xFF}
_IN_AIR = 0.1
"""Height (m) above which a vehicle flies."""


class View(Struct, frozen=True):
    """A vehicle as ground stations see it. Without a fresh pose it is not `healthy`."""

    pose: Pose
    origin: Origin
    home: tuple[float, float]
    mode: int
    armed: bool
    healthy: bool
    lands: bool = False

    @property
    def flies(self) -> bool:
        """Return whether the vehicle is in the air."""
        return self.pose.position.z > _IN_AIR

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
        """Return the health of the sensors; there is no battery to speak of."""
        healthy = _SENSORS if self.healthy else _SENSORS & ~mavlink.MAV_SYS_STATUS_PREARM_CHECK
        return mavlink.MAVLink_sys_status_message(
            _SENSORS, _SENSORS, healthy, 0, _UNKNOWN["u16"], -1, 100, 0, 0, 0, 0, 0, 0
        )

    def global_position_int(self) -> Any:
        """Return place and velocity on the earth: 1e-7 degrees, mm, cm/s."""
        p, v = self.pose.position, self.pose.velocity
        latitude, longitude = self.origin.to_earth(p.x, p.y)
        return mavlink.MAVLink_global_position_int_message(
            self._boot_ms,
            latitude,
            longitude,
            round((self.origin.altitude + p.z) * 1000),
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
        """Return the place as a receiver of satellites has it: 1e-7 degrees, mm, cm/s."""
        p, v = self.pose.position, self.pose.velocity
        latitude, longitude = self.origin.to_earth(p.x, p.y)
        return mavlink.MAVLink_gps_raw_int_message(
            round(self.pose.stamp * 1e6),
            mavlink.GPS_FIX_TYPE_3D_FIX,
            latitude,
            longitude,
            round((self.origin.altitude + p.z) * 1000),
            50,
            50,
            round(100 * hypot(v.x, v.y)),
            round(degrees(atan2(v.x, v.y)) * 100) % 36_000,
            12,
        )

    def extended_sys_state(self) -> Any:
        """Return whether the vehicle is on the ground."""
        state = mavlink.MAV_LANDED_STATE_ON_GROUND
        if self.flies:
            state = mavlink.MAV_LANDED_STATE_IN_AIR
            if self.lands:
                state = mavlink.MAV_LANDED_STATE_LANDING
            elif self.mode == TAKEOFF:
                state = mavlink.MAV_LANDED_STATE_TAKEOFF
        return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, state)

    def home_position(self) -> Any:
        """Return where the vehicle returns to: on the ground."""
        x, y = self.home
        latitude, longitude = self.origin.to_earth(x, y)
        altitude = round(self.origin.altitude * 1000)
        return mavlink.MAVLink_home_position_message(
            latitude, longitude, altitude, y, x, 0.0, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0
        )

    def vfr_hud(self) -> Any:
        """Return speed (m/s), heading and height, m."""
        p, v = self.pose.position, self.pose.velocity
        ground = hypot(v.x, v.y)
        return mavlink.MAVLink_vfr_hud_message(
            sqrt(ground * ground + v.z * v.z),
            ground,
            round(self._heading) % 360,
            50 if self.flies else 0,
            self.origin.altitude + p.z,
            v.z,
        )

    def autopilot_version(self) -> Any:
        """Return the abilities; the number of the version is that of the PX4 that we look like, 1.16.0."""
        release = 1 << 24 | 16 << 16 | 255
        none = [0] * 8
        return mavlink.MAVLink_autopilot_version_message(
            CAPABILITIES, release, 0, 0, 0, none, none, none, 0, 0, 0
        )

    @property
    def _heading(self) -> float:
        """Return the direction of the nose, degrees from north to east."""
        return degrees(_angles(attitude(self.pose.orientation))[2]) % 360


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


def _short(number: float) -> int:
    return min(max(round(number), -32_768), 32_767)
