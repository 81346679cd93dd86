"""The vehicle as a PX4, seen and flown by ground stations of MAVLink."""

import random
from contextlib import ExitStack
from math import dist, nan
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as mavlink

import quadctl
from quadctl.services.bridges.options import MavlinkOptions
from tests.support.mavlink import ORIGIN, GroundStation, bridge, key_file, near
from tests.support.running import eventually

ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
MISSION, FENCE = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE
ARM, TAKEOFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF
LAND = mavlink.MAV_CMD_NAV_LAND
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


@pytest.mark.thorough
def test_it_lands_disarms_and_takes_off_again(flying: GroundStation, run: quadctl.Run):
    assert flying.command(ARM, 0) == DENIED
    since = len(flying.messages)
    assert flying.command(LAND) == ACCEPTED
    flying.wait(
        "EXTENDED_SYS_STATE",
        lambda m: m.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND,
        since=since,
    )
    flying.wait("HEARTBEAT", lambda m: not m.base_mode & ARMED, since=since)
    assert flying.goto(1, 0, 1) == DENIED
    assert flying.text("not armed: arm first", since=since)
    assert flying.command(ARM, 1) == ACCEPTED
    assert flying.command(TAKEOFF, -1, 0, 0, nan, nan, nan, ORIGIN.altitude + 1.5) == ACCEPTED
    eventually(lambda: near(run, (0, 0, 1.5)))


@pytest.mark.thorough
def test_it_returns_to_its_start_at_its_height_and_lands(flying: GroundStation, run: quadctl.Run):
    assert flying.goto(2, 2, 2) == ACCEPTED
    eventually(lambda: near(run, (2, 2, 2)))
    since = len(flying.messages)
    mode = mavlink.MAVLink_set_mode_message(1, 1 | ARMED, 4 << 16 | 5 << 24)
    flying.send(mode)
    flying.wait("HEARTBEAT", lambda m: m.custom_mode == 4 << 16 | 5 << 24, since=since)
    flying.wait("HEARTBEAT", lambda m: not m.base_mode & ARMED, since=since)
    heights = [
        m.relative_alt / 1000
        for m in flying.messages[since:]
        if m.get_type() == "GLOBAL_POSITION_INT" and dist(ORIGIN.to_world(m.lat, m.lon), (0, 0)) > 1
    ]
    assert min(heights) > 1.9
    p = run.vehicle.pose().position
    assert dist((p.x, p.y, p.z), (0, 0, 0)) < 0.1


def square(station: GroundStation) -> list[Any]:
    """Takeoff, a speed, three points and a landing where it is."""
    fly, any_height = mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, nan)
    points = [station.item(fly, any_height, each, 1.2) for each in ((1, 0), (1, 1), (0, 1))]
    return [
        station.item(TAKEOFF, any_height, (0, 0), 1.0),
        station.item(
            mavlink.MAV_CMD_DO_CHANGE_SPEED, (1, 10, -1), (0, 0), 0, frame=mavlink.MAV_FRAME_MISSION
        ),
        *points,
        station.item(LAND, (), (0, 0), 0),
    ]


@pytest.mark.thorough
def test_a_mission_is_uploaded_flown_paused_resumed_and_downloaded(
    flying: GroundStation, run: quadctl.Run
):
    since, items = len(flying.messages), square(flying)
    assert flying.upload(MISSION, items) == mavlink.MAV_MISSION_ACCEPTED
    found = flying.download(MISSION)
    wanted = [make(number) for number, make in enumerate(items)]
    assert [(m.command, m.frame, m.x, m.y, round(m.z, 3)) for m in found] == [
        (m.command, m.frame, m.x, m.y, m.z) for m in wanted
    ]
    flying.send(mavlink.MAVLink_set_mode_message(1, 1, 4 << 16 | 4 << 24))
    flying.wait("MISSION_ITEM_REACHED", lambda m: m.seq == 2, since=since)
    assert flying.command(mavlink.MAV_CMD_NAV_LOITER_UNLIM) == ACCEPTED
    paused = flying.wait("MISSION_CURRENT", lambda m: m.mission_state == 4)
    assert (paused.seq, paused.total) == (3, 6)
    assert flying.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 4) == ACCEPTED
    flying.wait("MISSION_ITEM_REACHED", lambda m: m.seq == 5, since=since)
    flying.wait("HEARTBEAT", lambda m: not m.base_mode & ARMED, since=since)
    p = run.vehicle.pose().position
    assert dist((p.x, p.y, p.z), (0, 0, 0)) < 0.1
    reached = [m.seq for m in flying.messages[since:] if m.get_type() == "MISSION_ITEM_REACHED"]
    assert reached == [*range(6)]
    assert flying.wait("MISSION_CURRENT", lambda m: m.mission_state == 5).seq == 0


@pytest.mark.thorough
def test_a_mission_goes_on_from_the_item_that_is_set(flying: GroundStation, run: quadctl.Run):
    assert flying.upload(MISSION, square(flying)) == mavlink.MAV_MISSION_ACCEPTED
    flying.send(mavlink.MAVLink_mission_set_current_message(*flying.vehicle, 4))
    flying.wait("MISSION_CURRENT", lambda m: m.seq == 4)
    since = len(flying.messages)
    flying.send(mavlink.MAVLink_set_mode_message(1, 1, 4 << 16 | 4 << 24))
    flying.wait("MISSION_ITEM_REACHED", lambda m: m.seq == 4, since=since)
    flying.wait("HEARTBEAT", lambda m: not m.base_mode & ARMED, since=since)
    reached = [m.seq for m in flying.messages[since:] if m.get_type() == "MISSION_ITEM_REACHED"]
    assert reached == [4, 5]
    assert flying.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 6) == DENIED


@pytest.mark.parametrize(
    ("command", "params", "reason"),
    [
        (mavlink.MAV_CMD_DO_JUMP, (0, 3), "item 1: command 177 cannot be flown"),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, (1, 2), "item 1: the vehicle flies at 5 m/s, not at 2"),
    ],
)
def test_a_mission_that_cannot_be_flown_is_refused_and_the_old_one_stays(
    station: GroundStation, command: int, params: tuple[float, ...], reason: str
):
    first = [station.item(mavlink.MAV_CMD_NAV_WAYPOINT, (), (1, 1), 1)]
    assert station.upload(MISSION, first) == mavlink.MAV_MISSION_ACCEPTED
    since = len(station.messages)
    second = [*first, station.item(command, params, (0, 0), 0)]
    assert station.upload(MISSION, second) == mavlink.MAV_MISSION_UNSUPPORTED
    assert station.text(reason, since=since)
    assert len(station.download(MISSION)) == 1


@pytest.mark.thorough
def test_a_mission_out_of_the_cage_ends_at_the_point_before(
    flying: GroundStation, run: quadctl.Run
):
    fly, since = mavlink.MAV_CMD_NAV_WAYPOINT, len(flying.messages)
    items = [flying.item(fly, (), place, 1.5) for place in ((1, 0), (9, 0))]
    assert flying.upload(MISSION, items) == mavlink.MAV_MISSION_ACCEPTED
    assert flying.command(mavlink.MAV_CMD_MISSION_START, 0, 1) == ACCEPTED
    assert flying.text("outside the cage: x = ", since=since)
    flying.wait("HEARTBEAT", lambda m: m.custom_mode == 4 << 16 | 3 << 24)
    eventually(lambda: near(run, (1, 0, 1.5)))


@pytest.mark.thorough
def test_a_fence_is_our_zones(flying: GroundStation, run: quadctl.Run):
    corner, circle = (
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
    )
    places = ((-4, -4), (4, -4), (4, 4), (-4, 4))
    frame = mavlink.MAV_FRAME_GLOBAL
    items = [flying.item(corner, (4,), each, 0, kind=FENCE, frame=frame) for each in places]
    items.append(flying.item(circle, (0.5,), (2, 0), 0, kind=FENCE, frame=frame))
    assert flying.upload(FENCE, items) == mavlink.MAV_MISSION_ACCEPTED
    zones = run.vehicle.params["safety.zones"]
    assert [(zone["name"], zone.get("kind", "exclusion")) for zone in zones] == [
        ("fence 1", "inclusion"), ("fence 2", "exclusion"),
    ]  # fmt: skip
    for found, wanted in zip(zones[0]["polygon"], places, strict=True):
        assert dist(found, wanted) < 0.01
    down = flying.download(FENCE)
    assert [(m.command, m.param1) for m in down] == [*[(corner, 4.0)] * 4, (circle, 0.5)]
    assert flying.goto(4.5, 0, 1) == DENIED
    assert flying.goto(2, 0, 1) == DENIED
    vehicle = flying.vehicle
    cleared = flying.ask(mavlink.MAVLink_mission_clear_all_message(*vehicle, FENCE), "MISSION_ACK")
    assert (cleared.type, cleared.mission_type) == (mavlink.MAV_MISSION_ACCEPTED, FENCE)
    assert run.vehicle.params["safety.zones"] == []


@pytest.mark.thorough
def test_a_fence_that_is_no_zone_is_refused(station: GroundStation, run: quadctl.Run):
    back = mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT
    since = len(station.messages)
    items = [station.item(back, (), (0, 0), 1, kind=FENCE)]
    assert station.upload(FENCE, items) == mavlink.MAV_MISSION_UNSUPPORTED
    assert station.text("fence 1: command 5000 is no zone", since=since)
    run.vehicle.params["safety.zones"] = [
        {"name": "roof", "floor": 3.0, "circle": {"x": 3.0, "radius": 1.0}}
    ]
    station.wait_for(lambda: run.vehicle.params["safety.zones"])
    ask = mavlink.MAVLink_mission_request_list_message(*station.vehicle, FENCE)
    refused = station.ask(ask, "MISSION_ACK")
    assert refused.type == mavlink.MAV_MISSION_UNSUPPORTED
    assert station.text("zone roof has a floor or a ceiling", since=since)
    run.vehicle.params["safety.zones"] = []


def test_messages_for_others_and_of_others_are_left_alone(station: GroundStation):
    since = len(station.messages)
    hold = mavlink.MAV_CMD_NAV_LOITER_UNLIM
    for target in ((1, 100), (9, 1)):
        station.send(mavlink.MAVLink_command_long_message(*target, hold, 0, *(0,) * 7))
    station.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    station.send(mavlink.MAVLink_ping_message(0, 1, 0, 0))
    assert station.command(mavlink.MAV_CMD_GET_HOME_POSITION) == ACCEPTED
    answered = [m.command for m in station.messages[since:] if m.get_type() == "COMMAND_ACK"]
    assert answered == [mavlink.MAV_CMD_GET_HOME_POSITION]


def test_every_command_is_acknowledged_whatever_its_parameters(
    station: GroundStation, run: quadctl.Run
):
    noise = random.Random(7)
    values = (nan, float("inf"), -1.0, 0.5, 1e30, 300.0)
    for command in (16, 20, 21, 22, 176, 178, 192, 193, 207, 224, 241, 300, 400, 511, 512, 31_999):
        for _ in range(5):
            params = [noise.choice(values) for _ in range(7)]
            if command in {20, 21}:
                continue  # they need no parameters
            assert station.command(command, *params) != mavlink.MAV_RESULT_FAILED
    assert station.command(mavlink.MAV_CMD_NAV_LOITER_UNLIM) == ACCEPTED


@pytest.mark.thorough
def test_only_signed_packets_are_taken_with_a_key(tmp_path: Path):
    file = key_file(tmp_path, "a passphrase of the class")
    with (
        quadctl.launch() as run,
        GroundStation(key=MavlinkOptions(signing_key=str(file)).secret) as signed,
        bridge(run.realm, signed.port, "--signing-key", str(file)),
    ):
        beat = signed.wait("HEARTBEAT")
        assert beat.get_signed()
        assert signed.bad == 0
        assert signed.command(mavlink.MAV_CMD_NAV_LOITER_UNLIM) == ACCEPTED
        before = run.vehicle.state().request
        hold = mavlink.MAVLink_command_long_message(
            1, 1, mavlink.MAV_CMD_DO_FENCE_ENABLE, 0, 0, *(0,) * 6
        )
        for key in (None, b"x" * 32):
            with GroundStation(key=key) as other:
                signed.send_raw(other.packed(hold))
        # A forged packet from the future does not lock the station out.
        with GroundStation(key=b"y" * 32) as future:
            future._codec.signing.timestamp = 2**47
            signed.send_raw(future.packed(hold))
        repeated = signed.packed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        signed.send_raw(repeated)
        signed.send_raw(repeated)
        assert signed.command(mavlink.MAV_CMD_GET_HOME_POSITION) == ACCEPTED
        assert run.vehicle.state().cage_on
        assert run.vehicle.state().request == before


@pytest.mark.thorough
def test_a_station_may_come_and_go():
    with quadctl.launch() as run, ExitStack() as stack:
        with GroundStation() as first:
            stack.enter_context(bridge(run.realm, first.port))
            first.wait("HEARTBEAT")
        with GroundStation(port=first.port) as second:
            second.wait("HEARTBEAT")
            assert second.command(mavlink.MAV_CMD_NAV_LOITER_UNLIM) == ACCEPTED


@pytest.mark.thorough
def test_several_vehicles_are_systems_of_their_own():
    with (
        quadctl.launch(vehicles=2) as run,
        GroundStation(2) as station,
        bridge(run.realm, station.port),
    ):
        station.wait("HEARTBEAT")
        assert station.command(ARM, 1) == ACCEPTED
        assert station.goto(2, 1, 1.5) == ACCEPTED
        eventually(lambda: dist(spot(run.vehicles["uav1"]), (2, 1, 1.5)) < 0.1)
        assert spot(run.vehicles["uav0"])[2] < 1.2
        assert {m.get_srcSystem() for m in station.messages} == {1, 2}


def spot(vehicle: quadctl.Vehicle) -> tuple[float, float, float]:
    p = vehicle.pose().position
    return p.x, p.y, p.z
