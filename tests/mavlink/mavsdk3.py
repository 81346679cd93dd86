"""Program with MAVSDK 3 that flies what it can and prints the results, run by test_mavsdk.py.

python mavsdk3.py PORT
"""

import asyncio
import json
import sys
from collections.abc import AsyncIterator, Callable
from typing import Any

from mavsdk import System
from mavsdk.geofence import Circle, FenceType, GeofenceData, Point, Polygon
from mavsdk.mission import MissionItem, MissionPlan

METRE = 9e-6
LATITUDE, LONGITUDE, ALTITUDE = 47.397742, 8.545594, 488.0
NAN = float("nan")


async def result_of(call: Any) -> str:
    """Return the name of the result of a call."""
    try:
        await call
    except Exception as problem:  # noqa: BLE001 - each plugin has an error of its own
        return str(problem).partition(":")[0]
    return "SUCCESS"


async def until(stream: AsyncIterator[Any], condition: Callable[[Any], Any]) -> bool:
    """Wait for an element of a stream; return whether it has come."""

    async def search() -> bool:
        async for each in stream:
            if condition(each):
                return True
        return False

    try:
        return await asyncio.wait_for(search(), 20)
    except TimeoutError:
        return False


def item(north: int) -> MissionItem:
    return MissionItem(
        LATITUDE + north * METRE, LONGITUDE, 1.2, 10.0, True, NAN, NAN,
        MissionItem.CameraAction.NONE, NAN, NAN, NAN, NAN, NAN, MissionItem.VehicleAction.NONE,
    )  # fmt: skip


async def main() -> None:
    drone = System()
    await drone.connect(system_address=f"udpin://127.0.0.1:{sys.argv[1]}")
    action, telemetry = drone.action, drone.telemetry
    found: dict[str, Any] = {}
    texts: list[str] = []

    async def read() -> None:
        async for text in telemetry.status_text():
            texts.append(text.text)  # noqa: PERF401 - the stream has no end

    async def told() -> AsyncIterator[str]:
        while True:
            yield " ".join(texts)
            await asyncio.sleep(0.05)

    def at(height: float) -> Callable[[Any], bool]:
        return lambda position: abs(position.relative_altitude_m - height) < 0.1

    assert await until(drone.core.connection_state(), lambda state: state.is_connected)
    reading = asyncio.create_task(read())
    found["healthy"] = await until(telemetry.health(), lambda health: health.is_armable)
    found["takeoff height"] = await action.get_takeoff_altitude()
    found["cage"] = await drone.param.get_param_float("S_VIRTUAL_CAGE_X")
    found["all parameters"] = len((await drone.param.get_all_params()).float_params) > 30
    set_ = drone.param.set_param_float("S_ACCEPTANCE_RAN", 0.375)
    found["set"] = await result_of(set_)
    found["set the seed"] = await result_of(drone.param.set_param_int("D_SEED", 5))
    found["arm"] = await result_of(action.arm())
    found["takeoff"] = await result_of(action.takeoff())
    found["up"] = await until(telemetry.position(), at(1.0))
    inside = action.goto_location(LATITUDE + METRE, LONGITUDE, ALTITUDE + 1.5, 0.0)
    found["inside"] = await result_of(inside)
    found["there"] = await until(telemetry.position(), at(1.5))
    outside = action.goto_location(LATITUDE + 9 * METRE, LONGITUDE, ALTITUDE, 0.0)
    found["outside"] = await result_of(outside)
    found["why"] = await until(told(), lambda text: "outside the cage" in text)
    found["hold"] = await result_of(action.hold())
    corners = [
        Point(LATITUDE + a * METRE, LONGITUDE + b * METRE)
        for a, b in ((-4, -4), (-4, 4), (4, 4), (4, -4))
    ]
    circle = Circle(Point(LATITUDE - 3 * METRE, LONGITUDE), 0.5, FenceType.EXCLUSION)
    plan = GeofenceData([Polygon(corners, FenceType.INCLUSION)], [circle])
    found["fence"] = await result_of(drone.geofence.upload_geofence(plan))
    barred = action.goto_location(LATITUDE - 3 * METRE, LONGITUDE, ALTITUDE + 1, 0.0)
    found["in the fence"] = await result_of(barred)
    found["no fence"] = await result_of(drone.geofence.clear_geofence())
    items = MissionPlan([item(north) for north in (0, 1, 2)])
    found["mission"] = await result_of(drone.mission.upload_mission(items))
    found["mission back"] = len((await drone.mission.download_mission()).mission_items)
    found["start"] = await result_of(drone.mission.start_mission())
    progress = drone.mission.mission_progress()
    found["flown"] = await until(progress, lambda each: each.current == each.total)
    found["return"] = await result_of(action.return_to_launch())
    found["landed"] = await until(telemetry.armed(), lambda armed: not armed)
    reading.cancel()
    print(json.dumps(found))


asyncio.run(main())
