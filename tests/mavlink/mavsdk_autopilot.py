"""Autopilot made of MAVSDK's server plugins, for our safety: a point that flies to its setpoints.

python mavsdk_autopilot.py PORT; lines on stdin are the pilot's: a mode's name.
"""

import json
import sys
import threading
import time
from math import dist
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action_server import ActionServer, FlightMode
from mavsdk.plugins.mavlink_direct_server import MavlinkDirectServer, MavlinkMessage
from mavsdk.plugins.telemetry_server import (
    AngularVelocityBody,
    EulerAngle,
    PositionNed,
    PositionVelocityNed,
    TelemetryServer,
    VelocityNed,
)

LATITUDE, LONGITUDE, ALTITUDE = 47.397742, 8.545594, 488.0
SPEED, STEP = 2.0, 0.02
"""Speed (m/s) of the point, and seconds from one of its positions to the next."""
NO_PLACE = 0b111
"""Bits of a setpoint without a place."""


class Point:
    """Vehicle without a body: it flies straight to its target, and stops at once."""

    def __init__(self) -> None:
        self.place = [0.0, 0.0, -1.0]
        self.velocity = [0.0, 0.0, 0.0]
        self.target = [0.0, 0.0, -1.0]
        self.follows = False

    def aim(self, message: Any) -> None:
        fields = json.loads(message.fields_json)
        stays = int(fields["type_mask"]) & NO_PLACE
        self.target = [*self.place] if stays else [float(fields[axis]) for axis in "xyz"]

    def step(self) -> None:
        left = dist(self.place, self.target)
        way = min(SPEED * STEP, left) if self.follows else 0.0
        share = way / left if left else 0.0
        moved = [share * (t - p) for p, t in zip(self.place, self.target, strict=True)]
        self.place = [p + m for p, m in zip(self.place, moved, strict=True)]
        self.velocity = [m / STEP for m in moved]


def main() -> None:
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
    mavsdk.add_any_connection(f"udpout://127.0.0.1:{sys.argv[1]}")
    component = mavsdk.server_component()
    action, telemetry = ActionServer(component), TelemetryServer(component)
    direct, point = MavlinkDirectServer(component), Point()
    direct.subscribe_message("SET_POSITION_TARGET_LOCAL_NED", lambda m, _: point.aim(m))
    origin = {
        "latitude": round(LATITUDE * 1e7), "longitude": round(LONGITUDE * 1e7),
        "altitude": round(ALTITUDE * 1000), "time_usec": 0,
    }  # fmt: skip

    def fly() -> None:
        for count in range(1_000_000):
            point.step()
            telemetry.publish_attitude(
                EulerAngle(0.0, 0.0, 90.0, 0), AngularVelocityBody(0.0, 0.0, 0.0)
            )
            telemetry.publish_position_velocity_ned(
                PositionVelocityNed(PositionNed(*point.place), VelocityNed(*point.velocity))
            )
            if count % 50 == 0:
                direct.send_message(
                    MavlinkMessage("GPS_GLOBAL_ORIGIN", 1, 1, 0, 0, json.dumps(origin))
                )
            time.sleep(STEP)

    action.set_armable(armable=True, force_armable=True)
    action.set_armed_state(is_armed=True)
    threading.Thread(target=fly, daemon=True).start()
    for line in sys.stdin:
        mode = FlightMode[line.strip()]
        action.set_flight_mode_internal(mode)
        point.follows = mode == FlightMode.OFFBOARD


if __name__ == "__main__":
    main()
