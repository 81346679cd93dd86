"""Program with MAVSDK 4 that flies what it can and prints the results, run by test_mavsdk.py.

python mavsdk4.py PORT
"""

import json
import sys
import time
from collections.abc import Callable
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.action import Action
from mavsdk.plugins.geofence import Circle, FenceType, Geofence, GeofenceData, Point, Polygon
from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry

METRE = 9e-6
"""About a metre in degrees of latitude; so east of the origin it is about 0.68 m."""
LATITUDE, LONGITUDE, ALTITUDE = 47.397742, 8.545594, 488.0


def result_of(call: Callable[..., Any], *words: Any) -> str:
    """Return the name of the result of a call."""
    try:
        call(*words)
    except MavsdkError as problem:
        return problem.result.name
    return "SUCCESS"


def until(condition: Callable[[], Any]) -> bool:
    """Wait for a condition; return whether it has come true."""
    ends = time.monotonic() + 20
    while time.monotonic() < ends:
        if condition():
            return True
        time.sleep(0.05)
    return False


def main() -> None:
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
    system = mavsdk.first_autopilot(20.0)
    action, telemetry, param = Action(system), Telemetry(system), Param(system)
    mission, fence = Mission(system), Geofence(system)
    texts: list[str] = []
    telemetry.subscribe_status_text(lambda text, _: texts.append(text.text))
    found: dict[str, Any] = {}

    def at(height: float) -> Callable[[], bool]:
        return lambda: abs(telemetry.position().relative_altitude_m - height) < 0.1

    found["healthy"] = until(lambda: telemetry.health().is_armable)
    found["takeoff height"] = action.get_takeoff_altitude()
    found["cage"] = param.get_param_float("S_VIRTUAL_CAGE_X")
    found["all parameters"] = len(param.get_all_params().float_params) > 30
    found["set"] = result_of(param.set_param_float, "S_ACCEPTANCE_RAN", 0.375)
    found["set the seed"] = result_of(param.set_param_int, "D_SEED", 5)
    found["arm"] = result_of(action.arm)
    found["takeoff"] = result_of(action.takeoff)
    found["up"] = until(at(1.0))
    north = LATITUDE + METRE
    inside = (north, LONGITUDE, ALTITUDE + 1.5, 0.0)
    found["inside"] = result_of(action.goto_location, *inside)
    found["there"] = until(at(1.5))
    found["outside"] = result_of(action.goto_location, LATITUDE + 9 * METRE, LONGITUDE, ALTITUDE, 0)
    found["why"] = until(lambda: any("outside the cage" in text for text in texts))
    found["hold"] = result_of(action.hold)
    corners = [
        Point(LATITUDE + a * METRE, LONGITUDE + b * METRE)
        for a, b in ((-4, -4), (-4, 4), (4, 4), (4, -4))
    ]
    circle = Circle(Point(LATITUDE - 3 * METRE, LONGITUDE), 0.5, FenceType.EXCLUSION)
    plan = GeofenceData([Polygon(corners, FenceType.INCLUSION)], [circle])
    found["fence"] = result_of(fence.upload_geofence, plan)
    down = fence.download_geofence()
    found["fence back"] = [len(down.polygons[0].points), down.circles[0].radius]
    found["in the fence"] = result_of(
        action.goto_location, LATITUDE - 3 * METRE, LONGITUDE, ALTITUDE + 1, 0
    )
    found["no fence"] = result_of(fence.clear_geofence)
    items = [
        MissionItem(LATITUDE + a * METRE, LONGITUDE, 1.2, 10.0, is_fly_through=True)
        for a in (0, 1, 2)
    ]
    found["mission"] = result_of(mission.upload_mission, MissionPlan(items))
    found["mission back"] = len(mission.download_mission().mission_items)
    found["start"] = result_of(mission.start_mission)
    found["flown"] = until(mission.is_mission_finished)
    found["return"] = result_of(action.return_to_launch)
    found["landed"] = until(lambda: not telemetry.armed())
    print(json.dumps(found))


main()
