"""An autopilot in the place of our vehicle, with an autopilot of the test."""

from itertools import count
from math import inf, nan
from typing import Any

import pytest
from hypothesis import given, strategies as st
from msgspec.structs import astuple
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import Origin
from quadctl.schemas.messages import CageSize, Pose, Position, Quaternion, Setpoint, Zone
from quadctl.schemas.params import DynamicsParams
from quadctl.schemas.zones import CircleParams, ZoneParams
from quadctl.services.bridges.mavlink.adapter import AutopilotAdapter, Guarded
from quadctl.services.bridges.mavlink.plan import PlanItem, zones_of
from quadctl.services.bridges.mavlink.telemetry import View, turned

PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
OFFBOARD, POSITION, GUIDED = 6 << 16, 3 << 16, 4
OUR_ORIGIN = Origin(47.397742, 8.545594, 488.0)
THEIR_ORIGIN = Origin(47.39775, 8.54561, 486.0)
OFFSET = OUR_ORIGIN.to_world(*THEIR_ORIGIN.to_earth(0, 0))
LEVEL = Quaternion(1.0, 0.0, 0.0, 0.0)


class Notes(list[str]):
    """Log that is kept."""

    def info(self, text: str, *values: object) -> None:
        self.append(text % values)

    warning = info


class Autopilot:
    """Autopilot that sends what it is told to, on a clock of its own, and keeps what comes."""

    def __init__(self, *, kind: int = PX4, fenced: bool = False) -> None:
        self.kind, self.notes = kind, Notes()
        self.sent: list[Any] = []
        names = count(1)
        log: Any = self.notes
        self.adapter = AutopilotAdapter(
            OUR_ORIGIN, DynamicsParams(), self.keep, log,
            lambda: f"boot {next(names)}", fenced=fenced,
        )  # fmt: skip
        self.now, self.clock = 100.0, 5_000
        self.mode, self.armed = 0, False
        self.north = self.east = self.down = 0.0
        self.speed, self.beats = 0.0, True
        self.beat()

    def keep(self, message: Any) -> None:
        """Keep what comes; whatever happens, the pilot alone arms and changes the mode."""
        assert message.get_type() in {
            "HEARTBEAT", "COMMAND_LONG", "SET_POSITION_TARGET_LOCAL_NED", "MISSION_COUNT",
            "MISSION_ITEM_INT",
        }  # fmt: skip
        assert message.get_type() != "COMMAND_LONG" or message.command in {
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE,
        }  # fmt: skip
        self.sent.append(message)

    def give(self, message: Any, system: int = 1) -> Pose | None:
        """Let the adapter take a message, after its way through a packet."""
        codec = mavlink.MAVLink(None, system, 1)
        message = mavlink.MAVLink(None).parse_buffer(message.pack(codec))[0]
        return self.adapter.take(message, self.now)

    def beat(self) -> None:
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        self.give(mavlink.MAVLink_heartbeat_message(2, self.kind, 1 | armed, self.mode, 4, 3))
        self.beaten = self.now

    def put(self, mode: int, *, armed: bool = True) -> None:
        """Change mode and arming, as the pilot does."""
        self.mode, self.armed = mode, armed
        self.beat()

    def tell_origin(self, origin: Origin = THEIR_ORIGIN) -> None:
        x, y = origin.to_earth(0, 0)
        self.give(mavlink.MAVLink_gps_global_origin_message(x, y, round(1000 * origin.altitude)))

    def position(self, seconds: float = 0.02) -> Pose | None:
        """Let time pass, and report attitude and position; return the pose."""
        self.now += seconds
        self.clock += round(1000 * seconds)
        if self.beats and self.now - self.beaten > 0.9:
            self.beat()
        self.adapter.tick(self.now)
        level = 0.7071068, 0.0, 0.0, 0.7071068  # east of a north-east-down world
        self.give(mavlink.MAVLink_attitude_quaternion_message(self.clock, *level, 0.1, 0.2, 0.3))
        return self.give(
            mavlink.MAVLink_local_position_ned_message(
                self.clock, self.north, self.east, self.down, self.speed, 0.0, 0.0
            )
        )

    def ready(self) -> Pose:
        """Report everything that poses need, armed and in the mode of programs."""
        self.tell_origin()
        self.position()
        self.put(OFFBOARD if self.kind == PX4 else GUIDED)
        pose = self.position()
        assert pose is not None
        return pose

    def follow(self, pose: Pose, place: Position, *, brake: bool = False) -> None:
        self.adapter.follow(Setpoint(pose.boot, pose.seq, place, brake), self.now)

    def targets(self) -> list[Any]:
        """Return the setpoints that came since the last call."""
        found = [m for m in self.sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
        self.sent.clear()
        return found

    def commands(self) -> set[tuple[int, float]]:
        return {(m.command, m.param1) for m in self.sent if m.get_type() == "COMMAND_LONG"}


@pytest.fixture
def autopilot() -> Autopilot:
    return Autopilot()


def test_it_asks_for_positions_and_the_origin(autopilot: Autopilot):
    autopilot.position(3.0)
    assert autopilot.commands() >= {
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED),
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN),
    }


@pytest.mark.parametrize(("kind", "mode"), [(PX4, OFFBOARD), (ARDUPILOT, GUIDED)])
def test_poses_come_only_while_it_is_armed_and_follows_programs(kind: int, mode: int):
    autopilot = Autopilot(kind=kind)
    autopilot.tell_origin()
    for other, armed in ((0, False), (mode, False), (POSITION, True)):
        autopilot.put(other, armed=armed)
        assert autopilot.position() is None, other
    autopilot.put(mode)
    assert autopilot.position() is not None


def test_a_pose_is_the_position_in_our_world(autopilot: Autopilot):
    autopilot.north, autopilot.east, autopilot.down, autopilot.speed = 1.0, 2.0, -3.0, 0.5
    pose = autopilot.ready()
    x, y = OFFSET
    assert astuple(pose.position) == pytest.approx((2 + x, 1 + y, 1.0), abs=0.02)
    assert (pose.velocity.x, pose.velocity.y, pose.velocity.z) == (0.0, 0.5, 0.0)
    turned = pose.orientation
    assert (turned.w, turned.x, turned.y, turned.z) == pytest.approx((1, 0, 0, 0), abs=1e-6)
    rates = pose.body_rates
    assert (rates.x, rates.y, rates.z) == pytest.approx((0.1, -0.2, -0.3))
    assert (pose.boot, pose.seq, pose.stamp) == ("boot 1", 0, 0.0)
    later = autopilot.position(0.1)
    assert later is not None
    assert (later.boot, later.seq) == ("boot 1", 1)
    assert later.stamp == pytest.approx(0.1)


@pytest.mark.parametrize("roll", [0.0, 0.3, -2.0])
@pytest.mark.parametrize("pitch", [0.0, 0.5, -1.0])
@pytest.mark.parametrize("yaw", [0.0, 1.5, -3.0])
def test_an_attitude_in_angles_is_the_same(roll: float, pitch: float, yaw: float):
    autopilot = Autopilot()
    autopilot.ready()
    q = turned(roll, pitch, yaw)
    message = mavlink.MAVLink_attitude_quaternion_message(0, q.w, q.x, q.y, q.z, 0.1, 0.2, 0.3)
    found: list[Pose] = []
    for turn in (message, mavlink.MAVLink_attitude_message(0, roll, pitch, yaw, 0.1, 0.2, 0.3)):
        autopilot.give(turn)
        autopilot.clock += 20
        pose = autopilot.give(
            mavlink.MAVLink_local_position_ned_message(autopilot.clock, *(0.0,) * 6)
        )
        assert pose is not None
        found.append(pose)
    one, other = found
    assert astuple(one.orientation) == pytest.approx(astuple(other.orientation), abs=1e-6)
    assert astuple(one.body_rates) == pytest.approx(astuple(other.body_rates))
    view = View(one, OUR_ORIGIN, (0.0, 0.0), 0, True, True, (0, 0, 0)).attitude()
    assert (view.roll, view.pitch, view.yaw) == pytest.approx((roll, pitch, yaw), abs=1e-6)


def test_a_repeated_or_late_position_is_no_pose(autopilot: Autopilot):
    autopilot.ready()
    autopilot.clock -= 20
    assert autopilot.position() is None
    autopilot.clock -= 500
    assert autopilot.position() is None


@given(st.lists(st.sampled_from([nan, inf, -inf, 1e9, 0.0]), min_size=6, max_size=6))
def test_numbers_that_are_none_are_no_pose(numbers: list[float]):
    autopilot = Autopilot()
    autopilot.ready()
    autopilot.clock += 20
    pose = autopilot.give(mavlink.MAVLink_local_position_ned_message(autopilot.clock, *numbers))
    assert (pose is None) is any(numbers)


def test_a_goal_is_sent_in_its_world(autopilot: Autopilot):
    pose = autopilot.ready()
    autopilot.targets()
    autopilot.follow(pose, Position(1.0, 2.0, 3.0))
    autopilot.position(0.06)
    (target,) = autopilot.targets()
    x, y = OFFSET
    assert (target.x, target.y, target.z) == (
        pytest.approx(2 - y, abs=0.02), pytest.approx(1 - x, abs=0.02), pytest.approx(-5.0),
    )  # fmt: skip
    assert (target.type_mask, target.coordinate_frame) == (0b110111111000, 1)


def test_a_brake_is_velocity_0_and_then_its_place(autopilot: Autopilot):
    pose = autopilot.ready()
    autopilot.follow(pose, Position(1.0, 2.0, 3.0))
    autopilot.speed = 2.0
    autopilot.position(0.06)
    autopilot.targets()
    autopilot.follow(pose, Position(0.0, 0.0, 1.0), brake=True)
    autopilot.position(0.06)
    (target,) = autopilot.targets()
    assert (target.type_mask, target.vx, target.vy, target.vz) == (0b110111000111, 0, 0, 0)
    autopilot.speed, autopilot.north = 0.05, 7.0
    autopilot.follow(pose, Position(0.0, 0.0, 1.0), brake=True)
    autopilot.position(0.06)
    autopilot.targets()
    autopilot.north = 7.3  # by the wind
    autopilot.position(0.06)
    (target,) = autopilot.targets()
    assert (target.x, target.type_mask) == (pytest.approx(7.0), 0b110111111000)


def test_without_setpoints_it_brakes_and_a_long_silence_ends_the_flight(autopilot: Autopilot):
    pose = autopilot.ready()
    goal = Position(3.0, 0.0, 1.0)
    autopilot.speed = 2.0
    for silence, resumes in ((0.3, True), (3.0, False)):
        autopilot.follow(pose, goal)
        for _ in range(round(silence / 0.05)):
            autopilot.position(0.05)
        assert autopilot.targets()[-1].type_mask == 0b110111000111
        autopilot.follow(pose, goal)
        autopilot.position(0.06)
        assert (autopilot.targets()[-1].type_mask == 0b110111111000) is resumes
    autopilot.follow(pose, Position(2.0, 0.0, 1.0))
    autopilot.position(0.06)
    assert autopilot.targets()[-1].type_mask == 0b110111111000


def test_the_pilot_takes_over_and_gives_back(autopilot: Autopilot):
    first = autopilot.ready()
    autopilot.follow(first, Position(3.0, 0.0, 1.0))
    autopilot.put(POSITION)
    autopilot.targets()
    for _ in range(20):
        autopilot.north += 0.1
        assert autopilot.position(0.06) is None
        # Setpoints must come before the mode is changed: they are where it is.
        (target,) = autopilot.targets()
        assert target.x == pytest.approx(autopilot.north - 0.1, abs=0.11)
    autopilot.put(OFFBOARD)
    again = autopilot.position()
    assert again is not None
    assert (again.boot, again.seq) == ("boot 2", 0)
    # What safety wanted before counts no more.
    autopilot.follow(first, Position(3.0, 0.0, 1.0))
    autopilot.north += 0.5
    autopilot.position(0.06)
    assert autopilot.targets()[-1].x == pytest.approx(autopilot.north - 0.5)
    assert "the pilot flies" in " ".join(autopilot.notes)


def test_a_lost_autopilot_ends_the_flight_and_is_sent_nothing_more(autopilot: Autopilot):
    autopilot.ready()
    autopilot.now += 3.0
    autopilot.adapter.tick(autopilot.now)
    assert "the autopilot is silent" in autopilot.notes[-1]
    autopilot.targets()
    for _ in range(20):
        autopilot.now += 0.1
        autopilot.adapter.tick(autopilot.now)
    assert not autopilot.targets()
    # It may have started anew, with another origin: everything is asked for again.
    autopilot.beat()
    assert autopilot.position() is None
    autopilot.tell_origin(OUR_ORIGIN)
    pose = autopilot.position()
    assert pose is not None
    assert pose.boot == "boot 2"
    assert pose.position.x == pytest.approx(0.0, abs=0.02)


def test_without_heartbeats_nobody_knows_who_flies(autopilot: Autopilot):
    autopilot.ready()
    autopilot.beats = False
    flown = [autopilot.position(0.1) is not None for _ in range(60)]
    assert flown == sorted(flown, reverse=True)
    assert 20 < sum(flown) < 35


def test_an_ardupilot_is_sent_setpoints_only_for_our_flights_and_to_stop_them():
    autopilot = Autopilot(kind=ARDUPILOT)
    autopilot.put(GUIDED)
    for _ in range(10):
        autopilot.position(0.06)
    assert not autopilot.targets()
    autopilot.tell_origin()
    pose = autopilot.position()
    autopilot.position(0.06)
    assert pose is not None or autopilot.position() is not None
    autopilot.targets()
    autopilot.beats = False  # so nobody knows who flies
    for _ in range(100):
        autopilot.position(0.06)
    masks = [m.type_mask for m in autopilot.targets()]
    assert masks[0] == 0b110111111000
    assert masks[-1] == 0b110111000111
    for _ in range(100):
        autopilot.position(0.06)
    autopilot.targets()
    autopilot.position(0.06)
    assert not autopilot.targets()


def test_without_positions_no_place_is_sent(autopilot: Autopilot):
    autopilot.ready()
    autopilot.put(POSITION)
    autopilot.targets()
    for _ in range(30):
        autopilot.now += 0.1
        autopilot.beat()
        autopilot.adapter.tick(autopilot.now)
    assert len(autopilot.targets()) <= 6
    # Selected now, it must not fly to where it was last seen.
    autopilot.put(OFFBOARD)
    autopilot.now += 0.1
    autopilot.adapter.tick(autopilot.now)
    assert all(target.type_mask == 0b110111000111 for target in autopilot.targets())


def test_without_a_fence_no_place_outlasts_the_pilot():
    autopilot = Autopilot(fenced=True)
    autopilot.tell_origin()
    for mode in (OFFBOARD, POSITION, OFFBOARD):
        autopilot.put(mode)
        autopilot.north += 50
        for _ in range(4):
            autopilot.position(0.06)
    assert {m.type_mask for m in autopilot.targets()[-3:]} == {0b110111000111}


@pytest.mark.parametrize(("kind", "type_"), [(ARDUPILOT, 1), (PX4, 10), (8, 2), (18, 6)])
def test_what_is_no_copter_is_not_flown(kind: int, type_: int):
    autopilot = Autopilot()
    autopilot.now += 10
    autopilot.adapter.tick(autopilot.now)
    autopilot.give(mavlink.MAVLink_heartbeat_message(type_, kind, 129, GUIDED, 4, 3))
    autopilot.tell_origin()
    autopilot.beats = False
    assert autopilot.position() is None
    assert not any("found" in note for note in autopilot.notes[1:])


def test_an_origin_elsewhere_is_named(autopilot: Autopilot):
    autopilot.tell_origin(Origin(47.5, 8.5, 400.0))
    autopilot.put(OFFBOARD)
    assert autopilot.position() is None
    assert "over 1 km from ours" in " ".join(autopilot.notes)


def test_it_speaks_first_to_an_autopilot_that_is_sent_to():
    rig = Autopilot.__new__(Autopilot)
    rig.sent, rig.notes = [], Notes()
    adapter = AutopilotAdapter(
        OUR_ORIGIN, DynamicsParams(), rig.keep, rig.notes, str, fenced=False
    )  # fmt: skip
    adapter.tick(0.0)
    assert [m.get_type() for m in rig.sent] == ["HEARTBEAT"]


def test_a_new_start_of_the_autopilot_is_a_new_boot(autopilot: Autopilot):
    autopilot.ready()
    autopilot.clock = 10
    assert autopilot.position() is None
    autopilot.position()
    autopilot.beat()
    autopilot.tell_origin()
    pose = autopilot.position()
    assert pose is not None
    assert pose.boot == "boot 2"


def test_an_origin_that_moves_is_a_new_boot(autopilot: Autopilot):
    autopilot.ready()
    autopilot.tell_origin(OUR_ORIGIN)
    autopilot.targets()
    autopilot.adapter.tick(autopilot.now + 0.06)
    pose = autopilot.position(0.12)
    assert pose is not None
    assert pose.boot == "boot 2"
    assert pose.position.x == pytest.approx(0.0, abs=0.02)
    autopilot.position(0.06)
    places = [m for m in autopilot.targets() if m.type_mask == 0b110111111000]
    assert places
    assert all(abs(m.x) + abs(m.y) < 0.02 for m in places)


def test_other_systems_are_no_part_of_it(autopilot: Autopilot):
    autopilot.ready()
    other = mavlink.MAVLink_heartbeat_message(2, PX4, 1, POSITION, 4, 3)
    autopilot.give(other, system=2)
    stray = mavlink.MAVLink_local_position_ned_message(autopilot.clock + 5, 9, 9, 9, 0, 0, 0)
    assert autopilot.give(stray, system=2) is None
    assert autopilot.position() is not None


CAGE = Guarded(CageSize(5, 4, 3), (), 0.25)
WALL = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))


def test_it_flies_only_with_the_fence():
    autopilot = Autopilot(fenced=True)
    autopilot.tell_origin()
    autopilot.position()
    autopilot.put(OFFBOARD)
    assert autopilot.position() is None
    zones = (
        Zone.of(ZoneParams("tower", circle=CircleParams(1.0, 2.0, 0.5))),
        Zone.of(ZoneParams("low", polygon=WALL, ceiling=1.0)),
        Zone.of(ZoneParams("in", "inclusion", polygon=WALL)),
    )
    autopilot.adapter.guard(Guarded(CAGE.cage, zones, CAGE.margin))
    fence = upload(autopilot)
    assert [(zone.name, zone.kind) for zone in fence] == [
        ("fence 1", "inclusion"), ("fence 2", "exclusion"),
    ]  # fmt: skip
    assert fence[0].polygon[2] == (pytest.approx(5.25, abs=0.02), pytest.approx(4.25, abs=0.02))
    assert fence[1].circle.radius == 0.5
    assert autopilot.position() is not None


def test_a_refused_fence_is_named():
    autopilot = Autopilot(fenced=True)
    autopilot.tell_origin()
    autopilot.put(OFFBOARD)
    autopilot.adapter.guard(CAGE)
    upload(autopilot, mavlink.MAV_MISSION_UNSUPPORTED)
    assert autopilot.position() is None
    assert "has not taken the fence: refused with 3" in " ".join(autopilot.notes)
    # It may have been busy.
    upload(autopilot)
    assert autopilot.position() is not None


def test_a_fence_without_an_answer_is_uploaded_again():
    autopilot = Autopilot(fenced=True)
    autopilot.tell_origin()
    autopilot.adapter.guard(CAGE)
    for _ in range(200):
        autopilot.position(0.1)
    assert "no answer" in " ".join(autopilot.notes)
    upload(autopilot)
    autopilot.put(OFFBOARD)
    assert autopilot.position() is not None


def upload(autopilot: Autopilot, result: int = mavlink.MAV_MISSION_ACCEPTED) -> list[ZoneParams]:
    """Take an upload, like a vehicle; return its zones."""
    autopilot.sent.clear()
    counts: list[Any] = []
    while not counts:
        autopilot.position(0.1)
        counts = [m for m in autopilot.sent if m.get_type() == "MISSION_COUNT"]
    items: list[PlanItem] = []
    autopilot.give(mavlink.MAVLink_mission_ack_message(245, 191, 0, 1))
    for number in range(counts[0].count):
        autopilot.sent.clear()
        autopilot.give(mavlink.MAVLink_mission_request_int_message(245, 191, number, 1))
        (m,) = (m for m in autopilot.sent if m.get_type() == "MISSION_ITEM_INT")
        assert m.seq == number
        params = (m.param1, m.param2, m.param3, m.param4)
        items.append(PlanItem(m.frame, m.command, params, m.x, m.y, m.z))
    # This one is for another program, and the one above is late, for an upload before.
    autopilot.give(mavlink.MAVLink_mission_ack_message(255, 190, 0, 1))
    autopilot.give(mavlink.MAVLink_mission_ack_message(245, 191, result, 1))
    autopilot.adapter.tick(autopilot.now)
    return zones_of(items, OUR_ORIGIN)
