"""What QGroundControl asks of a vehicle, item by item, by its source of autumn 2026."""

from math import nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

import quadctl
from tests.support.mavlink import ORIGIN, GroundStation, near
from tests.support.running import eventually

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED
MISSION, FENCE = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE
ARM, TAKEOFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF
LAND = mavlink.MAV_CMD_NAV_LAND
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


@pytest.mark.thorough
def test_a_takeoff_before_arming_begins_when_it_is_armed(flying: GroundStation, run: quadctl.Run):
    since = len(flying.messages)
    assert flying.command(LAND) == ACCEPTED
    flying.wait("HEARTBEAT", lambda m: not m.base_mode & ARMED, since=since)
    assert flying.command(TAKEOFF) == ACCEPTED
    assert run.vehicle.pose().position.z < 0.1
    assert flying.command(ARM, 1) == ACCEPTED
    eventually(lambda: near(run, (0, 0, run.vehicle.params["safety.takeoff"])))


@pytest.mark.thorough
def test_a_pause_stops_and_a_change_of_height_keeps_the_place(
    flying: GroundStation, run: quadctl.Run
):
    reposition = mavlink.MAV_CMD_DO_REPOSITION
    assert flying.goto(4, 0, 1) == ACCEPTED
    eventually(lambda: run.vehicle.pose().position.x > 0.3)
    assert flying.command(reposition, -1, 1, 0, nan, nan, nan, nan) == ACCEPTED
    eventually(lambda: run.vehicle.state().state == "HOVERING")
    stopped = run.vehicle.pose().position
    assert stopped.x < 3.5
    assert flying.command(reposition, -1, 1, 0, nan, nan, nan, ORIGIN.altitude + 2) == ACCEPTED
    eventually(lambda: near(run, (stopped.x, stopped.y, 2)))


def test_parameters_are_listed(station: GroundStation):
    since = len(station.messages)
    station.send(mavlink.MAVLink_param_request_list_message(1, 0))
    first = station.wait("PARAM_VALUE", since=since)
    wanted = set(range(first.param_count))

    def values() -> dict[int, Any]:
        return {m.param_index: m for m in station.messages[since:] if m.get_type() == "PARAM_VALUE"}

    station.wait_for(lambda: wanted <= values().keys())
    names = {m.param_id for m in values().values()}
    assert {"MIS_TAKEOFF_ALT", "S_VIRTUAL_CAGE_X", "D_SEED"} <= names
    assert len(names) == first.param_count
    assert all(
        m.param_type in {mavlink.MAV_PARAM_TYPE_REAL32, mavlink.MAV_PARAM_TYPE_INT32}
        for m in values().values()
    )


@pytest.mark.thorough
def test_messages_come_at_the_rates_that_are_set(station: GroundStation):
    number = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    set_, get = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL

    def times(count: int) -> list[int]:
        since = len(station.messages)

        def found() -> list[int]:
            name = "LOCAL_POSITION_NED"
            return [m.time_boot_ms for m in station.messages[since:] if m.get_type() == name]

        station.wait_for(lambda: len(found()) > count)
        return found()

    assert station.command(set_, number, 20_000) == ACCEPTED
    asked = mavlink.MAVLink_command_long_message(*station.vehicle, get, 0, number, *(0,) * 6)
    assert station.ask(asked, "MESSAGE_INTERVAL").interval_us == 20_000
    fast = times(100)
    # Poses of their own, every second one of 100 Hz: of those of 20 Hz, each would come 2.5 times.
    assert len(set(fast)) > 0.5 * len(fast)
    assert station.command(set_, number, -1) == ACCEPTED
    assert station.ask(asked, "MESSAGE_INTERVAL").interval_us == -1
    assert station.command(set_, number, 0) == ACCEPTED
    # The first one comes at once, and each has the newest pose, which is up to 50 ms old.
    slow = times(10)[1:]
    assert 90 <= (slow[-1] - slow[0]) / (len(slow) - 1) <= 300
    assert station.command(set_, mavlink.MAVLINK_MSG_ID_RAW_IMU, 0) == UNSUPPORTED


def test_qgroundcontrol_gets_the_version_and_capabilities(station: GroundStation):
    for command, *params in (
        (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
        (mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1),
    ):
        since = len(station.messages)
        assert station.command(command, *params) == ACCEPTED
        found = station.wait("AUTOPILOT_VERSION", since=since)
        assert found.flight_sw_version >= 1 << 24 | 4 << 16
        for bit in ("MISSION_INT", "COMMAND_INT", "MISSION_FENCE", "MAVLINK2"):
            assert found.capabilities & getattr(mavlink, f"MAV_PROTOCOL_CAPABILITY_{bit}")


@pytest.mark.parametrize("message", [435, 397, 395, 259, 280])
def test_qgroundcontrols_requests_for_more_are_answered_at_once(
    station: GroundStation, message: int
):
    assert station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message, 1) == UNSUPPORTED


def test_qgroundcontrols_search_for_files_ends_at_once(station: GroundStation):
    name = b"@PARAM/param.pck?withdefaults=1"
    payload = [7, 0, 0, 4, len(name), 0, 0, 0, 0, 0, 0, 0, *name]
    asked = mavlink.MAVLink_file_transfer_protocol_message(
        0, 1, 1, [*payload, *(0,) * (251 - len(payload))]
    )
    answer = station.ask(asked, "FILE_TRANSFER_PROTOCOL")
    assert answer.payload[:13] == [8, 0, 0, 129, 1, 4, 0, 0, 0, 0, 0, 0, 10]
    assert answer.target_system == 255


@pytest.mark.thorough
def test_qgroundcontrol_gets_plans_of_all_kinds(station: GroundStation):
    for kind in (MISSION, FENCE, mavlink.MAV_MISSION_TYPE_RALLY):
        assert station.upload(kind, []) == mavlink.MAV_MISSION_ACCEPTED
        assert station.download(kind) == []


@pytest.mark.thorough
def test_qgroundcontrol_sees_what_it_does_not_ask_for(station: GroundStation):
    for name in (
        "HEARTBEAT", "HOME_POSITION", "EXTENDED_SYS_STATE", "SYS_STATUS", "GPS_RAW_INT",
        "GLOBAL_POSITION_INT", "ATTITUDE", "ATTITUDE_QUATERNION", "VFR_HUD", "MISSION_CURRENT",
    ):  # fmt: skip
        assert station.wait(name).get_srcComponent() == 1


@pytest.mark.thorough
@pytest.mark.parametrize("sub", [4, 3])
def test_qgroundcontrol_sees_a_change_of_mode_at_once(flying: GroundStation, sub: int):
    # It gives up after 1.3 s, in which a heartbeat of 1 Hz may come too late.
    point = [flying.item(mavlink.MAV_CMD_NAV_WAYPOINT, (), (1, 1), 1)]
    assert flying.upload(MISSION, point) == mavlink.MAV_MISSION_ACCEPTED
    since, mode = len(flying.messages), 4 << 16 | sub << 24
    flying.send(mavlink.MAVLink_set_mode_message(1, 1, mode))
    flying.wait("HEARTBEAT", lambda m: m.custom_mode == mode, since=since)
