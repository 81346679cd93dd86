"""Vehicle in a network of MAVLink: its telemetry, and the messages that it takes.

Messages are taken on the link's thread. Everything that calls a service is done by the vehicle's
RequestQueue, so a silent service keeps no telemetry back.
"""

import threading
import time
from collections.abc import Callable
from functools import partial
from math import isfinite, isnan, nan
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import Origin
from quadctl.schemas.messages import Pose, Position, SafetyState
from quadctl.schemas.topics import POSE_SLOW
from quadctl.services.bridges.base import AGE, BridgedVehicle, Log, RequestQueue
from quadctl.services.bridges.mavlink import parameters
from quadctl.services.bridges.mavlink.commander import (
    Commander,
    Send,
    Unsupported,
    number,
)
from quadctl.services.bridges.mavlink.plan import NOWHERE, PlanItem, point_of
from quadctl.services.bridges.mavlink.telemetry import NO_PLACE, NO_VELOCITY, View, no_file, texts
from quadctl.services.bridges.mavlink.transfers import Peer, Transfer, Transfers
from quadctl.services.runtime.errors import Invalid, NotAllowed, QuadctlError, Refused

_FRESH = 1.0
"""Age (s) of the newest pose of a healthy vehicle."""
_RATES = {
    "heartbeat": 1.0,
    "sys_status": 1.0,
    "extended_sys_state": 2.0,
    "home_position": 0.5,
    "mission_current": 1.0,
    "gps_raw_int": 5.0,
    "vfr_hud": 5.0,
    "global_position_int": 10.0,
    "local_position_ned": 10.0,
    "attitude": 10.0,
    "attitude_quaternion": 10.0,
}
"""Messages a second; a ground station changes them by MAV_CMD_SET_MESSAGE_INTERVAL."""
_NUMBERS = {
    getattr(mavlink, f"MAVLINK_MSG_ID_{name.upper()}"): name
    for name in (*_RATES, "autopilot_version", "gps_global_origin")
}
_SHORTEST, _LONGEST = 0.02, 60.0
"""Least and greatest interval of messages, s."""
_SAME = 1.0
"""Seconds within which the same text of safety's state and of a reply is one."""
_SLOW = 1 / POSE_SLOW.hz
"""Interval of the slow poses, s."""


class MavlinkSystem:
    """Vehicle in the form of a PX4. `send` takes messages for all ground stations, from any thread.

    `watch` is called with whether it wants all poses, or only the slow ones.
    """

    def __init__(
        self,
        vehicle: BridgedVehicle,
        watch: Callable[[bool], None],
        origin: Origin,
        send: Send,
        log: Log,
    ) -> None:
        self._parameters, self._watch, self._send, self._log = vehicle.parameters, watch, send, log
        self._origin = origin
        self._commander = Commander(vehicle, origin, send, self._show_once)
        self._transfers = Transfers(self._commander)
        self.learn_start = self._commander.learn_start
        self._boot, self._seen = "", 0.0
        self._shown = (0, False)
        self._texts, self._showing = 0, threading.Lock()
        self._shown_by: dict[str, tuple[str, float]] = {}
        self._intervals = {name: 1 / rate for name, rate in _RATES.items()}
        self._due = dict.fromkeys(_RATES, 0.0)
        self._requests = RequestQueue(self._failed)
        self._streaming: dict[int, Callable[[PlanItem], None]] = {
            mavlink.MAV_CMD_REQUEST_MESSAGE: lambda item: self._show(
                _NUMBERS.get(number(item.params[0]), "")
            ),
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda _: self._show(
                "autopilot_version"
            ),
            mavlink.MAV_CMD_GET_HOME_POSITION: lambda _: self._show("home_position"),
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
        }

    def see(self, message: Pose | SafetyState) -> None:
        """Take the newest pose or state of the vehicle."""
        self._commander.see(message)
        if isinstance(message, Pose):
            self._boot, self._seen = message.boot, time.monotonic()

    def tick(self, now: float) -> None:
        """Send the telemetry that is due, and the request that a transfer repeats."""
        if self._boot:
            if (shown := (self._commander.mode, self._commander.armed)) != self._shown:
                # Ground stations wait for the change, some for 1.3 s only.
                self._shown, self._due["heartbeat"] = shown, 0.0
            due = [n for n, at in self._due.items() if now >= at and self._intervals[n] > 0]
            view = self._view() if due else None
            for name in due:
                self._due[name] = max(self._due[name] + self._intervals[name], now)
                self._send(getattr(view, name)())
        if self._commander.is_due_to_follow:
            self._requests.order(self._commander.follow, "OFFBOARD")
        if self._transfers.uploading:
            self._requests.read(lambda: self._reply(self._transfers.tick(now)), "again")

    def take(self, message: Any, now: float) -> None:
        """Take a message of a ground station."""
        m, type_, requests = message, message.get_type(), self._requests
        peer = m.get_srcSystem(), m.get_srcComponent()
        match type_:
            case "COMMAND_LONG" | "COMMAND_INT":
                # One with integers has no number of its repetitions.
                again = type_ == "COMMAND_INT" or m.confirmation > 0
                self._command(peer, _command_of(m), again=again)
            case "SET_MODE":
                mode = m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24
                requests.order(partial(self._commander.set_mode, *mode), (type_, *mode))
            case "SET_POSITION_TARGET_LOCAL_NED":
                self._take_target(m)
            case "SET_POSITION_TARGET_GLOBAL_INT":
                self._take_global_target(m)
            case "MISSION_SET_CURRENT":
                requests.order(partial(self._commander.fly_from, m.seq), (type_, m.seq))
            case "PARAM_REQUEST_LIST":
                requests.read(self._send_parameters, type_)
            case "PARAM_REQUEST_READ":
                wanted = m.param_id, m.param_index
                requests.read(partial(self._read_parameter, *wanted), (type_, *wanted))
            case "PARAM_SET":
                given = m.param_id, m.param_type, m.param_value
                requests.read(partial(self._set_parameter, *given), (type_, *given))
            case "FILE_TRANSFER_PROTOCOL":
                self._send(no_file(m, peer))
            case _ if type_ in Transfers.MESSAGES:
                key = type_, peer, m.mission_type, getattr(m, "seq", 0)
                requests.read(lambda: self._reply(self._transfers.take(m, now)), key)

    # Texts

    def _failed(self, problem: Exception) -> None:
        """Show why a request without an answer of its own failed."""
        if isinstance(problem, Unsupported):
            self._show_text("the vehicle has no such mode")
        elif isinstance(problem, QuadctlError):
            self._show_once(problem.message, "reply")
        else:
            self._log.error("a request failed", exc_info=problem)

    def _show_once(self, text: str, source: str) -> None:
        """Show a text, which the state and a reply may both have, once."""
        with self._showing:
            now = time.monotonic()
            other, at = self._shown_by.pop(text, (source, now))
            if other != source and now - at < _SAME:
                return
            self._shown_by = {text: (source, now)}
        self._show_text(text)

    def _show_text(self, text: str) -> None:
        with self._showing:
            self._texts = self._texts % 0xFFFF + 1
            parts = texts(text, number=self._texts)
        for part in parts:
            self._send(part)

    def _reply(self, transfer: Transfer) -> None:
        if transfer.reason:
            self._show_text(transfer.reason)
        for message in transfer.messages:
            self._send(message)

    # Commands

    def _take_target(self, m: Any) -> None:
        if m.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
            self._commander.ignore(f"in {_frame(m.coordinate_frame)}")
        elif not m.type_mask & NO_PLACE:
            self._aim(m.y, m.x, -m.z)
        elif not (m.type_mask & NO_VELOCITY or m.vx or m.vy or m.vz):
            self._commander.aim(None)
        else:
            self._commander.ignore(_without_place(m))

    def _take_global_target(self, m: Any) -> None:
        if m.type_mask & NO_PLACE:
            self._commander.ignore(_without_place(m))
            return
        item = PlanItem(m.coordinate_frame, 0, (0.0,) * 4, m.lat_int, m.lon_int, m.alt)
        try:
            place = point_of(item, self._origin)
        except Invalid:
            self._commander.ignore(f"in {_frame(m.coordinate_frame)} or beyond the earth")
            return
        self._aim(place.x, place.y, place.z)

    def _aim(self, *place: float | None) -> None:
        x, y, z = (nan if part is None else part for part in place)
        if all(map(isfinite, (x, y, z))):
            self._commander.aim(Position(x, y, z))
        else:
            self._commander.ignore("without a number for each coordinate")

    def _command(self, peer: Peer, item: PlanItem, *, again: bool) -> None:
        """Execute a command; one that may be sent `again` is executed once meanwhile."""
        job = partial(self._execute, peer, item)
        newest = "goal" if item.command == mavlink.MAV_CMD_DO_REPOSITION else None
        match self._requests.order(job, (peer, repr(item)), newest=newest, once=again):
            case "waits":
                self._acknowledge(peer, item.command, mavlink.MAV_RESULT_IN_PROGRESS)
            case "full":
                self._acknowledge(peer, item.command, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)

    def _execute(self, peer: Peer, item: PlanItem) -> None:
        result = mavlink.MAV_RESULT_FAILED
        try:
            self._streaming.get(item.command, self._commander.do)(item)
            result = mavlink.MAV_RESULT_ACCEPTED
        except Unsupported:
            result = mavlink.MAV_RESULT_UNSUPPORTED
        except QuadctlError as problem:
            if isinstance(problem, Invalid | Refused | NotAllowed):
                result = mavlink.MAV_RESULT_DENIED
            self._show_once(problem.message, "reply")
        finally:
            self._acknowledge(peer, item.command, result)

    def _acknowledge(self, peer: Peer, command: int, result: int) -> None:
        self._send(mavlink.MAVLink_command_ack_message(command, result, 255, 0, *peer))

    def _view(self) -> View:
        return self._commander.view(healthy=time.monotonic() - self._seen < _FRESH)

    def _show(self, name: str) -> None:
        if not name:
            raise Unsupported
        self._send(getattr(self._view(), name)())

    def _set_interval(self, item: PlanItem) -> None:
        name, microseconds = _NUMBERS.get(number(item.params[0]), ""), item.params[1]
        if name not in self._intervals or not isfinite(microseconds):
            raise Unsupported
        # 0 stands for the default, and a negative one turns the message off.
        interval = microseconds / 1e6 or 1 / _RATES[name]
        if name == "heartbeat" and not 0 < interval <= 1:
            raise Refused("a vehicle without a heartbeat once a second counts as lost")
        bounded = min(max(interval, _SHORTEST), _LONGEST)
        self._intervals[name] = bounded if interval > 0 else -1.0
        shortest = min((each for each in self._intervals.values() if each > 0), default=_SLOW)
        self._watch(shortest < _SLOW)
        self._due[name] = 0.0

    def _get_interval(self, item: PlanItem) -> None:
        message = number(item.params[0], most=0xFFFF)
        interval = self._intervals.get(_NUMBERS.get(message, ""), 0.0)
        microseconds = round(interval * 1e6) if interval >= 0 else -1
        self._send(mavlink.MAVLink_message_interval_message(message, microseconds))

    # Parameters

    def _send_parameters(self) -> None:
        found = self._table()
        for index, each in enumerate(found):
            self._send_parameter(each, len(found), index)

    def _table(self) -> list[parameters.MavlinkParameter]:
        return parameters.table(self._parameters.read(AGE))

    def _send_parameter(self, each: parameters.MavlinkParameter, count: int, index: int) -> None:
        name = each.name.encode()
        self._send(mavlink.MAVLink_param_value_message(name, each.value, each.type, count, index))

    def _read_parameter(self, name: str, wanted: int) -> None:
        found = self._table()
        for index, each in enumerate(found):
            if index == wanted or (wanted < 0 and each.name == name):
                self._send_parameter(each, len(found), index)

    def _set_parameter(self, name: str, type_: int, value: float) -> None:
        own = next((each.own for each in self._table() if each.name == name), "")
        if not own:
            raise Invalid(f"there is no parameter {name}")
        ours = self._parameters
        try:
            ours.set({own: parameters.decoded(type_, value, ours.get(own))})
        except QuadctlError as problem:
            self._show_text(f"{name}: {problem.message}")
        # The ground station compares the present value with its own.
        ours.forget()
        self._read_parameter(name, -1)


def _frame(number: int) -> str:
    """Return the name of a frame in MAVLink, e.g. `MAV_FRAME_BODY_NED`."""
    known = mavlink.enums["MAV_FRAME"].get(number)
    return known.name if known else f"frame {number}"


def _without_place(target: Any) -> str:
    """Return the kind of a target without a whole place."""
    some = target.type_mask & NO_PLACE != NO_PLACE
    return "of some coordinates only" if some else "of velocity or acceleration"


def _command_of(m: Any) -> PlanItem:
    """Return the command of a message, whose place is in degrees or in units of 1e-7 degrees."""
    params = m.param1, m.param2, m.param3, m.param4
    if m.get_type() == "COMMAND_INT":
        return PlanItem(m.frame, m.command, params, m.x, m.y, m.z)
    x, y = (_degrees(each) for each in (m.param5, m.param6))
    return PlanItem(mavlink.MAV_FRAME_GLOBAL, m.command, params, x, y, m.param7)


def _degrees(value: float) -> int:
    """Return degrees in units of 1e-7; NOWHERE for no number."""
    return NOWHERE if isnan(value) else round(min(max(value, -1e3), 1e3) * 1e7)
