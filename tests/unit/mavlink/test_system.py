"""A vehicle that takes messages and sends telemetry, with services of the test."""

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, strategies as st
from msgspec import Struct
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import Origin
from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Quaternion,
    SafetyState,
    Velocity,
)
from quadctl.schemas.services import (
    GetParamsRequest,
    GetParamsResponse,
    GotoRequest,
    SetParamsResponse,
)
from quadctl.schemas.topics import Service
from quadctl.services.bridges.mavlink.system import MavlinkSystem
from quadctl.services.runtime.errors import Refused
from quadctl.services.runtime.params.remote import RemoteParams
from tests.support.running import eventually

VALUES = {
    "safety.takeoff": 1.0,
    "safety.zones": [],
    "dynamics.control.max_speed": 5.0,
    "dynamics.start.x": 0.0,
    "dynamics.start.y": 0.0,
}
ARM, TAKEOFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF
REPOSITION, LAND = mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_CMD_NAV_LAND
HOLD, NAN = mavlink.MAV_CMD_NAV_LOITER_UNLIM, float("nan")
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
AT_WALL = "outside the cage"


OFFERS = [
    EndpointInfo("uav", "@srv", node, "GetParams", "", 0.0, f"uav/@srv/{node}/get_params")
    for node in ("dynamics", "safety")
]


class Rig:
    """Vehicle that is where it was sent at once; safety refuses what is beyond 5 m, and `log` tells."""

    def __init__(self, x: float = 0.0, y: float = 0.0) -> None:
        self.sent: list[Any] = []
        self.orders: list[Any] = []
        self.parameters = RemoteParams(self._call, lambda: OFFERS)
        self.gate = threading.Event()
        self.gate.set()
        self.faults: list[logging.LogRecord] = []
        log = logging.getLogger(f"rig {id(self)}")
        log.addHandler(_Keep(self.faults))
        vehicle: Any = self
        self.system = MavlinkSystem(vehicle, self.watch, Origin(), self._send, log)
        self._number, self.boot = 0, "a"
        self.place = Position(x, y, 1.0)
        self.goal, self.request = self.place, 0
        self.system.learn_start()
        self.pose()
        self.state()

    def pose(self, place: Position | None = None) -> None:
        """Report a place of the vehicle, which rests there."""
        self.place = place or self.place
        self._number += 1
        zero = 0.0
        self.system.see(
            Pose(
                self.boot, self._number, self._number / 20, self.place, Velocity(zero, zero, zero),
                Quaternion(1.0, zero, zero, zero), BodyRates(zero, zero, zero),
            )
        )  # fmt: skip

    def state(self, name: str = "HOVERING", reason: str = "") -> None:
        """Report a state of safety."""
        self.flight = name
        self.system.see(
            SafetyState(
                self.boot, 0.0, self.request, name, self.goal, True, CageSize(5, 5, 5), reason  # type: ignore[arg-type]
            )
        )  # fmt: skip

    def fly(self, request: GotoRequest) -> None:
        self.gate.wait(10)
        self.orders.append((request.x, request.y, request.z))
        self.request += 1
        if max(abs(request.x), abs(request.y), request.z) > 5:
            self.state(self.flight, AT_WALL)
            raise Refused(AT_WALL)
        self.goal = Position(request.x, request.y, request.z)
        self.state("MOVING")

    def hold(self) -> None:
        self.orders.append("hold")
        self.goal = self.place
        self.state(reason="hold: stopped on request")

    def toggle_cage(self, *, on: bool) -> None:
        self.orders.append(on)

    def calibrate(self) -> float:
        self.orders.append("calibrate")
        return 0.0

    def watch(self, every_pose: bool) -> None:
        self.orders.append(every_pose)

    def reset(self) -> None:
        """Begin a new boot, on the floor."""
        self.boot = "b"
        self.pose(Position(0.0, 0.0, 0.0))
        self.state()

    def arrive(self) -> None:
        """Report the arrival at the goal."""
        self.pose(self.goal)
        self.state()

    def give(self, message: Any) -> None:
        """Give the system a message, as it comes from the wire."""
        packet = message.pack(mavlink.MAVLink(None, 255, 190))
        self.system.take(mavlink.MAVLink(None).decode(bytearray(packet)), time.monotonic())

    def command(self, command: int, *params: float) -> int:
        """Execute a command, and return the result of its only answer."""
        before = len(self.acks)
        filled = (*params, *(NAN,) * (7 - len(params)))
        self.give(mavlink.MAVLink_command_long_message(1, 1, command, 0, *filled))
        eventually(lambda: len(self.acks) > before)
        result: int = self.acks[before].result
        return result

    @property
    def acks(self) -> list[Any]:
        return [each for each in self.sent if each.get_type() == "COMMAND_ACK"]

    @property
    def texts(self) -> list[str]:
        return [each.text for each in self.sent if each.get_type() == "STATUSTEXT"]

    def telemetry(self, name: str) -> Any:
        """Let the system send what is due, and return the newest message of a type."""
        self.system.tick(time.monotonic() + 1000)
        return next(each for each in reversed(self.sent) if each.get_type() == name)

    def upload(self, *commands: tuple[int, float, float, float]) -> int:
        """Upload a mission of commands with first parameter, degrees north and height."""
        self.give(mavlink.MAVLink_mission_count_message(1, 1, len(commands), 0))
        for number, (command, first, north, height) in enumerate(commands):
            x = round((Origin().latitude + north) * 1e7) if north else 0
            y = round(Origin().longitude * 1e7) if north else 0
            self.give(
                mavlink.MAVLink_mission_item_int_message(
                    1, 1, number, 6, command, 0, 1, first, 0, 0, 0, x, y, height, 0
                )
            )

        def ended() -> Any:
            return [each for each in self.sent if each.get_type() == "MISSION_ACK"]

        result: int = eventually(ended)[-1].type
        self.sent = [each for each in self.sent if each.get_type() != "MISSION_ACK"]
        return result

    def _send(self, message: Any) -> None:
        message.pack(mavlink.MAVLink(None, 1, 1))
        self.sent.append(message)

    def _call(self, service: Service[Any, Any], request: Struct) -> Any:
        if not isinstance(request, GetParamsRequest):
            return SetParamsResponse(success=True, reason="")
        node = service.node
        return GetParamsResponse(
            {n: v for n, v in VALUES.items() if n.startswith(node) or n in request.names}
        )


class _Keep(logging.Handler):
    def __init__(self, kept: list[logging.LogRecord]) -> None:
        super().__init__()
        self._kept = kept

    def emit(self, record: logging.LogRecord) -> None:
        self._kept.append(record)


@pytest.fixture
def rig() -> Rig:
    return Rig()


commands = st.sampled_from(
    [16, 17, 20, 21, 22, 176, 178, 192, 193, 207, 224, 241, 300, 400, 410, 510, 511, 512, 520, 31_999]
)  # fmt: skip
numbers = st.floats(width=32) | st.sampled_from([0.0, 1.0, 4.0, 7.0, 300.0, 100_000.0, 1e-3])


@pytest.mark.thorough
@given(commands, st.tuples(*[numbers] * 7))
def test_every_command_has_one_answer_whatever_its_parameters(command: int, params: Any):
    rig = _shared_rig()
    before = len(rig.acks)
    assert rig.command(command, *params) != mavlink.MAV_RESULT_FAILED
    rig.system.tick(time.monotonic() + 1000)
    assert len(rig.acks) == before + 1
    assert not rig.faults
    rig.sent.clear()


_rigs: list[Rig] = []


def _shared_rig() -> Rig:
    """Return one rig for all examples: each has three threads."""
    if not _rigs:
        _rigs.append(Rig())
    return _rigs[0]


def test_a_command_that_is_repeated_meanwhile_is_executed_once(rig: Rig):
    rig.gate.clear()
    for _ in range(3):
        rig.give(
            mavlink.MAVLink_command_long_message(1, 1, REPOSITION, 0, -1, 0, 0, 0, NAN, NAN, 490)
        )
    eventually(lambda: len(rig.acks) == 2)
    assert {ack.result for ack in rig.acks} == {mavlink.MAV_RESULT_IN_PROGRESS}
    rig.gate.set()
    eventually(lambda: len(rig.acks) == 3)
    assert rig.acks[-1].result == ACCEPTED
    assert rig.orders == [(0.0, 0.0, 2.0)]


def test_a_refused_goal_does_not_end_the_flight_before_it(rig: Rig):
    assert rig.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    assert rig.command(REPOSITION, -1, 0, 0, 0, NAN, NAN, 500) == DENIED
    # Safety shows it in its state, too: the text comes once.
    assert rig.texts.count(AT_WALL) == 1
    rig.arrive()
    eventually(lambda: rig.orders[-1] == (0.0, 0.0, 0.0))
    rig.arrive()
    eventually(lambda: rig.telemetry("HEARTBEAT").base_mode & 128 == 0)


def test_it_returns_to_its_start_wherever_the_bridge_first_saw_it():
    rig = Rig(3.0, 2.0)
    assert rig.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    assert rig.orders == [(0.0, 0.0, 1.0)]
    # After a reset, it starts where the parameters are by now.
    rig.boot = "b"
    rig.pose(Position(1.0, 2.0, 0.0))
    home = rig.telemetry("HOME_POSITION")
    assert (home.y, home.x) == (1.0, 2.0)


def test_a_stop_comes_after_the_goal_that_is_being_requested(rig: Rig):
    assert rig.upload((16, 0, 1e-5, 1.5), (16, 0, 2e-5, 1.5)) == 0
    assert rig.command(mavlink.MAV_CMD_MISSION_START, 0, 0) == ACCEPTED
    rig.gate.clear()
    rig.arrive()
    stop = threading.Thread(target=rig.command, args=(HOLD,))
    stop.start()
    rig.gate.set()
    stop.join()
    assert rig.orders[-1] == "hold"
    assert rig.telemetry("HEARTBEAT").custom_mode == 4 << 16 | 3 << 24


@pytest.mark.parametrize(
    "happens",
    [
        lambda rig: rig.hold(),
        lambda rig: rig.fly(GotoRequest(2.0, 2.0, 2.0)),
        lambda rig: rig.reset(),
    ],
    ids=["hold", "goto", "reset"],
)
def test_a_mission_ends_when_others_stop_move_or_reset_the_vehicle(
    rig: Rig, happens: Callable[[Rig], Any]
):
    assert rig.upload((16, 1000, 1e-5, 1.5), (16, 0, 2e-5, 1.5)) == 0
    assert rig.command(mavlink.MAV_CMD_MISSION_START, 0, 0) == ACCEPTED
    rig.arrive()
    happens(rig)
    eventually(lambda: rig.telemetry("HEARTBEAT").custom_mode == 4 << 16 | 3 << 24)


def test_a_pause_of_safety_does_not_end_a_mission(rig: Rig):
    assert rig.upload((16, 0, 1e-5, 1.5), (16, 0, 2e-5, 1.5)) == 0
    assert rig.command(mavlink.MAV_CMD_MISSION_START, 0, 0) == ACCEPTED
    goal = rig.goal
    rig.goal = Position(0.0, 0.5, 1.2)
    rig.state("HOVERING", "paused: no pose for 0.2 s")
    rig.goal = goal
    rig.state("MOVING", "went on after a pause: no pose for 0.2 s")
    rig.arrive()
    eventually(lambda: len([o for o in rig.orders if isinstance(o, tuple)]) == 2)
    assert rig.telemetry("MISSION_CURRENT").seq == 1


def test_a_disarmed_vehicle_stays_on_the_ground(rig: Rig):
    rig.reset()
    delay = mavlink.MAV_CMD_NAV_DELAY
    assert rig.upload((delay, 1000, 0, 0), (16, 0, 1e-5, 1.5)) == 0
    rig.give(mavlink.MAVLink_set_mode_message(1, 1, 4 << 16 | 4 << 24))
    assert rig.command(ARM, 1) == ACCEPTED
    assert rig.telemetry("HEARTBEAT").custom_mode == 4 << 16 | 4 << 24
    assert rig.command(ARM, 0) == ACCEPTED
    assert rig.orders == ["hold"]
    assert rig.telemetry("HEARTBEAT").custom_mode == 4 << 16 | 3 << 24


def test_a_mission_uploaded_after_its_mode_is_the_one_that_is_flown(rig: Rig):
    rig.reset()
    assert rig.upload((16, 0, 1e-5, 1.5)) == 0
    rig.give(mavlink.MAVLink_set_mode_message(1, 1, 4 << 16 | 4 << 24))
    eventually(lambda: rig.telemetry("HEARTBEAT").custom_mode == 4 << 16 | 4 << 24)
    assert rig.upload((16, 0, 1e-5, 2.5)) == 0
    assert rig.command(ARM, 1) == ACCEPTED
    assert [order[2] for order in rig.orders] == [2.5]
    assert rig.upload((16, 0, 1e-5, 1.5)) == mavlink.MAV_MISSION_UNSUPPORTED


def test_an_item_that_is_not_there_changes_nothing(rig: Rig):
    assert rig.upload((16, 0, 1e-5, 1.5), (16, 0, 2e-5, 1.5)) == 0
    for command in (mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT):
        for first in (2, 7, 100_000):
            assert rig.command(command, first) == DENIED
    assert rig.command(mavlink.MAV_CMD_MISSION_START, 0, 0.5) == DENIED
    assert rig.telemetry("MISSION_CURRENT").seq == 0


def test_a_change_of_mode_is_sent_before_the_next_heartbeat_is_due(rig: Rig):
    now = time.monotonic()
    rig.system.tick(now)
    rig.sent.clear()
    assert rig.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    rig.system.tick(now + 0.02)
    (beat,) = [each for each in rig.sent if each.get_type() == "HEARTBEAT"]
    assert beat.custom_mode == 4 << 16 | 5 << 24


def test_a_takeoff_has_the_height_of_its_frame(rig: Rig):
    for frame, z, height in ((0, 490.0, 2.0), (6, 3.0, 3.0)):
        rig.give(
            mavlink.MAVLink_command_int_message(
                1, 1, frame, TAKEOFF, 0, 0, 0, 0, 0, 0, 2**31 - 1, 2**31 - 1, z
            )
        )
        eventually(lambda: rig.orders)
        assert rig.orders.pop()[2] == height
    # In the air it does not go down.
    rig.arrive()
    assert rig.command(TAKEOFF) == ACCEPTED
    assert rig.orders[-1] == (0.0, 0.0, 3.0)


SET_OFFBOARD = (mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0)
VELOCITY, HEIGHT = 0xDC7, 0xDFB
"""Masks of setpoints that hold a velocity, or a height, and nothing else."""


def on_earth(frame: int, height: float = 2.0, north: float = 0.0, mask: int = 0xDF8) -> Any:
    """Return a setpoint on the earth, some degrees north of the origin."""
    x, y = round((Origin().latitude + north) * 1e7), round(Origin().longitude * 1e7)
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask, x, y, height, 1, 0, 0, 0, 0, 0, 0, 0
    )


def local(frame: int = 1, x: float = 1.0, mask: int = 0xDF8) -> Any:
    """Return a setpoint in a local frame, 2 m to the east and 3 m high in that of the world."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, x, 2, -3, 1, 0, 0, 0, 0, 0, 0, 0
    )


def test_offboard_flies_to_places_in_the_world_and_on_the_earth(rig: Rig):
    assert rig.command(ARM, 1) == ACCEPTED
    rig.give(local())
    assert rig.command(*SET_OFFBOARD) == ACCEPTED
    for target, goal in (
        (local(), (2.0, 1.0, 3.0)),
        (on_earth(0, 490.0, 1e-5), (0.0, 1.1, 2.0)),
        (on_earth(6, 3.0, 1e-5), (0.0, 1.1, 3.0)),
    ):
        rig.give(target)
        rig.system.tick(time.monotonic())
        eventually(lambda: rig.orders[-1] != "hold")
        assert rig.orders.pop() == pytest.approx(goal, abs=0.02)


@pytest.mark.parametrize(
    ("target", "kind"),
    [
        pytest.param(local(mask=VELOCITY), "of velocity or acceleration", id="velocity"),
        pytest.param(local(mask=HEIGHT), "of some coordinates only", id="height"),
        pytest.param(local(frame=8), "in MAV_FRAME_BODY_NED", id="body"),
        pytest.param(local(frame=99), "in frame 99", id="unknown-frame"),
        pytest.param(local(x=NAN), "without a number for each coordinate", id="no-number"),
        pytest.param(on_earth(6, mask=VELOCITY), "of velocity or", id="velocity-on-earth"),
        pytest.param(on_earth(6, mask=HEIGHT), "of some coordinates", id="height-on-earth"),
        pytest.param(on_earth(11), "in MAV_FRAME_GLOBAL_TERRAIN_ALT_INT", id="terrain"),
        pytest.param(on_earth(6, north=100.0), "or beyond the earth", id="beyond-the-earth"),
    ],
)
def test_setpoints_that_are_not_flown_are_refused_by_their_kind(rig: Rig, target: Any, kind: str):
    assert rig.command(ARM, 1) == ACCEPTED
    rig.give(target)
    assert rig.command(*SET_OFFBOARD) == DENIED
    assert kind in "".join(rig.texts)
    rig.give(local())
    assert rig.command(*SET_OFFBOARD) == ACCEPTED


def test_a_long_text_ends_with_a_chunk_that_is_not_full():
    from quadctl.services.bridges.mavlink.telemetry import texts

    for length in (1, 49, 50, 51, 99, 100, 101):
        found = texts("x" * length, number=3)
        assert "".join(each.text for each in found) == "x" * length
        assert len(found[-1].text) < 50 or len(found) == 1
        assert all(each.id == (3 if length > 50 else 0) for each in found)
