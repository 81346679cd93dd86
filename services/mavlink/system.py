"""Vehicle in a network of MAVLink: its telemetry, and the messages that it takes.

Messages are taken on the link's thread. Everything that calls a service is done in order on a
thread of the vehicle's own, so a silent service keeps no telemetry back.
"""

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from functools import partial
from math import isfinite
from queue import Full, Queue
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.messages import Pose, SafetyState, Zones
from quadctl.schemas.topics import POSE_SLOW
from quadctl.services.mavlink import parameters
from quadctl.services.mavlink.commander import (
    Commander,
    Send,
    Unsupported,
    VehicleServices,
    number,
)
from quadctl.services.mavlink.geo import Origin
from quadctl.services.mavlink.plan import NOWHERE, PlanItem
from quadctl.services.mavlink.telemetry import View, no_file, texts
from quadctl.services.mavlink.transfers import Peer, Transfer, Transfers
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused

_MOST_WAITING = 64
"""Requests that may wait; further ones are refused."""
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
    for name in (*_RATES, "autopilot_version")
}
_SHORTEST = 0.02
"""Least interval of messages, s."""
_SLOW = 1 / POSE_SLOW.hz
"""Interval of the slow poses, s."""

Log = logging.Logger | logging.LoggerAdapter[logging.Logger]


class MavlinkSystem:
    """Vehicle in the form of a PX4. `send` takes messages for all ground stations, from any thread."""

    def __init__(self, services: VehicleServices, origin: Origin, send: Send, log: Log) -> None:
        self._services, self._send, self._log = services, send, log
        self._commander = Commander(services, origin, send, self._show_text)
        self._transfers = Transfers(self._commander)
        self._boot, self._seen = "", 0.0
        self._shown = (0, False)
        self._texts = 0
        self._intervals = {name: 1 / rate for name, rate in _RATES.items()}
        self._due = dict.fromkeys(_RATES, 0.0)
        self._requests: Queue[Callable[[], None]] = Queue(_MOST_WAITING)
        self._pending: set[Any] = set()
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
        threading.Thread(target=self._work, daemon=True).start()

    def see(self, message: Pose | SafetyState | Zones) -> None:
        """Take the newest pose, state or zones of the vehicle."""
        self._commander.see(message)
        if isinstance(message, Pose):
            self._seen = time.monotonic()
            if message.boot != self._boot:
                self._boot = message.boot
                self._queue("start", self._commander.learn_start)

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
        if self._transfers.uploading:
            self._queue("again", lambda: self._reply(self._transfers.tick(now)))

    def take(self, message: Any, now: float) -> None:
        """Take a message of a ground station."""
        type_, peer = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
        if type_ in Transfers.MESSAGES:
            key = (type_, peer, message.mission_type, getattr(message, "seq", 0))
            self._queue(key, lambda: self._reply(self._transfers.take(message, now)))
        elif take := self._takers.get(type_):
            take(self, message, peer)

    # Requests

    def _queue(self, key: Any, job: Callable[[], None]) -> bool:
        """Do a job after those before it; return false for one that waits already, or has no place.

        The sender repeats a request without an answer.
        """
        if key in self._pending:
            return False
        self._pending.add(key)

        def do() -> None:
            try:
                job()
            finally:
                self._pending.discard(key)

        with contextlib.suppress(Full):
            self._requests.put_nowait(do)
            return True
        self._pending.discard(key)
        return False

    def _work(self) -> None:
        while True:
            job = self._requests.get()
            try:
                job()
            except Unsupported:
                self._show_text("the vehicle has no such mode")
            except QuadctlError as problem:
                self._commander.explain(problem)
            except Exception:  # noqa: BLE001
                # A fault in one request must not end all later ones.
                self._log.exception("a request failed")

    def _show_text(self, text: str) -> None:
        self._texts = self._texts % 0xFFFF + 1
        for part in texts(text, number=self._texts):
            self._send(part)

    def _reply(self, transfer: Transfer) -> None:
        if transfer.reason:
            self._show_text(transfer.reason)
        for message in transfer.messages:
            self._send(message)

    # Commands

    def _take_command_long(self, m: Any, peer: Peer) -> None:
        x, y = (_degrees(each) for each in (m.param5, m.param6))
        params = (m.param1, m.param2, m.param3, m.param4)
        frame = mavlink.MAV_FRAME_GLOBAL
        self._command(peer, PlanItem(frame, m.command, params, x, y, m.param7))

    def _take_command_int(self, m: Any, peer: Peer) -> None:
        params = (m.param1, m.param2, m.param3, m.param4)
        self._command(peer, PlanItem(m.frame, m.command, params, m.x, m.y, m.z))

    def _take_set_mode(self, m: Any, _peer: Peer) -> None:
        main, sub = m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24
        self._queue(("SET_MODE", main, sub), partial(self._commander.set_mode, main, sub))

    def _take_set_current(self, m: Any, _peer: Peer) -> None:
        self._queue(("SET_CURRENT", m.seq), partial(self._commander.fly_from, m.seq))

    def _command(self, peer: Peer, item: PlanItem) -> None:
        """Execute a command; one that is repeated meanwhile is executed once."""
        key = (peer, repr(item))
        is_repeated = key in self._pending
        if not self._queue(key, partial(self._execute, peer, item)):
            waits = mavlink.MAV_RESULT_IN_PROGRESS
            result = waits if is_repeated else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            self._acknowledge(peer, item.command, result)

    def _execute(self, peer: Peer, item: PlanItem) -> None:
        result = mavlink.MAV_RESULT_FAILED
        try:
            self._streaming.get(item.command, self._commander.do)(item)
            result = mavlink.MAV_RESULT_ACCEPTED
        except Unsupported:
            result = mavlink.MAV_RESULT_UNSUPPORTED
        except QuadctlError as problem:
            if isinstance(problem, Invalid | Refused):
                result = mavlink.MAV_RESULT_DENIED
            self._commander.explain(problem)
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
        self._intervals[name] = max(interval, _SHORTEST) if interval > 0 else -1.0
        shortest = min((each for each in self._intervals.values() if each > 0), default=_SLOW)
        self._services.watch(every_pose=shortest < _SLOW)
        self._due[name] = 0.0

    def _get_interval(self, item: PlanItem) -> None:
        message = number(item.params[0], most=0xFFFF)
        interval = self._intervals.get(_NUMBERS.get(message, ""), 0.0)
        microseconds = round(interval * 1e6) if interval >= 0 else -1
        self._send(mavlink.MAVLink_message_interval_message(message, microseconds))

    # Parameters and files

    def _take_list(self, _m: Any, _peer: Peer) -> None:
        self._queue("PARAM_REQUEST_LIST", self._send_parameters)

    def _send_parameters(self) -> None:
        found = self._table()
        for index, each in enumerate(found):
            self._send_parameter(each, len(found), index)

    def _table(self) -> list[parameters.MavlinkParameter]:
        return parameters.table(self._services.parameters.read())

    def _send_parameter(self, each: parameters.MavlinkParameter, count: int, index: int) -> None:
        name = each.name.encode()
        self._send(mavlink.MAVLink_param_value_message(name, each.value, each.type, count, index))

    def _take_read(self, m: Any, _peer: Peer) -> None:
        name, index = m.param_id, m.param_index
        self._queue(("PARAM_READ", name, index), partial(self._read_parameter, name, index))

    def _read_parameter(self, name: str, wanted: int) -> None:
        found = self._table()
        for index, each in enumerate(found):
            if index == wanted or (wanted < 0 and each.name == name):
                self._send_parameter(each, len(found), index)

    def _take_set(self, m: Any, _peer: Peer) -> None:
        given = m.param_id, m.param_type, m.param_value
        self._queue(("PARAM_SET", *given), partial(self._set_parameter, *given))

    def _set_parameter(self, name: str, type_: int, value: float) -> None:
        present = self._services.parameters.read()
        own = next((p.own for p in parameters.table(present) if p.name == name), "")
        if not own:
            raise Invalid(f"there is no parameter {name}")
        try:
            self._services.parameters.set({own: parameters.decoded(type_, value, present[own])})
        except QuadctlError as problem:
            self._show_text(f"{name}: {problem.message}")
        # The ground station compares the present value with its own.
        self._read_parameter(name, -1)

    def _take_file_request(self, m: Any, peer: Peer) -> None:
        self._send(no_file(m, peer))

    _takers = {  # noqa: RUF012
        "COMMAND_LONG": _take_command_long,
        "COMMAND_INT": _take_command_int,
        "SET_MODE": _take_set_mode,
        "MISSION_SET_CURRENT": _take_set_current,
        "PARAM_REQUEST_LIST": _take_list,
        "PARAM_REQUEST_READ": _take_read,
        "PARAM_SET": _take_set,
        "FILE_TRANSFER_PROTOCOL": _take_file_request,
    }


def _degrees(value: float) -> int:
    """Return degrees in units of 1e-7; NOWHERE for no place on the earth."""
    return round(value * 1e7) if abs(value) <= 180 else NOWHERE
