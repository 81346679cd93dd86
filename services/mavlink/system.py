"""System: one vehicle in a network of MAVLink, with its telemetry, commands, parameters and plans."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite
from queue import Full, Queue
from typing import Any, Protocol

from msgspec import to_builtins
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.messages import Pose, Position, SafetyState, Zone, Zones
from quadctl.schemas.services import GotoRequest, GotoResponse
from quadctl.schemas.zones import ZoneParams
from quadctl.services.mavlink import parameters
from quadctl.services.mavlink.geo import Origin
from quadctl.services.mavlink.pilot import Errand, Pilot
from quadctl.services.mavlink.plan import Item, Step, items_of, steps_of, zones_of
from quadctl.services.mavlink.telemetry import HOLD, LAND, MISSION, RETURN, TAKEOFF, View
from quadctl.services.mavlink.transfers import (
    Count,
    Ended,
    Kind,
    Peer,
    Reply,
    Sent,
    Store,
    Transfers,
    Wanted,
)
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused, Unreachable

COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1
_MOST_WAITING = 64
"""Commands that may wait; beyond, they are refused."""
_FRESH = 1.0
"""Age (s) of the newest pose of a healthy vehicle."""
_RATES = {
    "heartbeat": 1.0,
    "sys_status": 1.0,
    "extended_sys_state": 2.0,
    "home_position": 0.5,
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
_DONE, _BUSY, _DENIED, _UNSUPPORTED, _FAILED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
    mavlink.MAV_RESULT_FAILED,
)
Send = Callable[[Any], None]
Log = logging.Logger | logging.LoggerAdapter[logging.Logger]


class Backend(Protocol):
    """Services of the vehicle; all methods block, and raise QuadctlError."""

    def goto(self, request: GotoRequest) -> GotoResponse:
        """Request a goal from safety."""

    def hold(self) -> None:
        """Stop the vehicle."""

    def toggle_cage(self, *, on: bool) -> None:
        """Turn the cage on or off."""

    def calibrate(self) -> None:
        """Zero the barometer."""

    def parameters(self) -> dict[str, Any]:
        """Return all parameters by dotted name."""

    def set_parameters(self, values: dict[str, Any]) -> None:
        """Set parameters of one node, all or none."""


class System:
    """Vehicle as a PX4. `send` takes messages for all ground stations; it may be called by any thread."""

    def __init__(self, number: int, backend: Backend, origin: Origin, send: Send, log: Log) -> None:
        """Take the number of the system, from 1."""
        self.number, self._log = number, log
        self._backend, self._origin, self._send = backend, origin, send
        self._pose: Pose | None = None
        self._seen = 0.0
        self._home = (0.0, 0.0)
        self._boot = ""
        self._zones: tuple[Zone, ...] = ()
        self._armed = False
        self._reason = ""
        self._mission: list[Item] = []
        self._intervals = {name: 1 / rate for name, rate in _RATES.items()}
        self._due = dict.fromkeys(_RATES, 0.0)
        self._transfers = Transfers(Store(self._load, self._save))
        self._pilot = Pilot(backend.goto, self._on_reached, self._on_end)
        self._requests: Queue[Callable[[], None]] = Queue(_MOST_WAITING)
        self._pending: set[tuple[Any, ...]] = set()
        threading.Thread(target=self._work, daemon=True).start()

    def see(self, message: Pose | SafetyState | Zones) -> None:
        """Take the newest pose, state or zones of the vehicle."""
        if isinstance(message, Zones):
            self._zones = message.zones
            return
        self._pilot.see(message)
        if isinstance(message, SafetyState):
            if message.reason and message.reason != self._reason:
                self.tell(message.reason)
            self._reason = message.reason
            return
        if message.boot != self._boot:
            self._boot, self._home = message.boot, (message.position.x, message.position.y)
            self._armed = False
        self._pose, self._seen = message, time.monotonic()
        if self._view().flies and not self._armed:
            # It takes off by itself, by `safety.takeoff`, or was flown by our own commands.
            self._armed = True

    def tick(self, now: float) -> None:
        """Send the telemetry that is due, and what a transfer repeats."""
        if self._pose is not None:
            view = self._view()
            for name, due in self._due.items():
                if now >= due and self._intervals[name] > 0:
                    self._due[name] = max(due + self._intervals[name], now)
                    self._send(getattr(view, name)())
        if (peer := self._transfers.peer) and (reply := self._transfers.tick(now)):
            self._answer(peer, reply)

    def tell(self, text: str, severity: int = mavlink.MAV_SEVERITY_WARNING) -> None:
        """Show a text at the ground stations, in as many messages as it needs."""
        data = text.encode()
        for number, start in enumerate(range(0, len(data), 50)):
            part = data[start : start + 50]
            self._send(mavlink.MAVLink_statustext_message(severity, part, len(data) > 50, number))

    def take(self, message: Any, now: float) -> None:
        """Take a message of a ground station."""
        handler = getattr(self, f"_on_{message.get_type().lower()}", None)
        if handler is not None:
            handler(message, (message.get_srcSystem(), message.get_srcComponent()), now)

    # Commands

    def _on_command_long(self, m: Any, peer: Peer, _now: float) -> None:
        params = (m.param1, m.param2, m.param3, m.param4)
        x, y = (round(each * 1e7) if isfinite(each) else 0 for each in (m.param5, m.param6))
        self._command(
            peer, m.command, Item(mavlink.MAV_FRAME_GLOBAL, m.command, params, x, y, m.param7)
        )

    def _on_command_int(self, m: Any, peer: Peer, _now: float) -> None:
        params = (m.param1, m.param2, m.param3, m.param4)
        self._command(peer, m.command, Item(m.frame, m.command, params, m.x, m.y, m.z))

    def _on_set_mode(self, m: Any, peer: Peer, _now: float) -> None:
        main, sub = m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24
        params = (float(m.base_mode), float(main), float(sub), 0.0)
        self._command(peer, mavlink.MAV_CMD_DO_SET_MODE, Item(0, 0, params, 0, 0, 0.0))

    def _command(self, peer: Peer, command: int, item: Item) -> None:
        """Execute a command after those before it; one that is repeated meanwhile is executed once."""
        key = (peer, command, repr(item))
        if key in self._pending:
            return
        self._pending.add(key)
        try:
            self._requests.put_nowait(partial(self._execute, key, peer, command, item))
        except Full:
            self._pending.discard(key)
            self._acknowledge(peer, command, _BUSY)

    def _execute(self, key: tuple[Any, ...], peer: Peer, command: int, item: Item) -> None:
        result, reason = _UNSUPPORTED, ""
        try:
            if do := self._commands().get(command):
                do(item)
                result = _DONE
        except Refused as problem:
            result, reason = _DENIED, problem.message
        except Invalid as problem:
            result, reason = _UNSUPPORTED, problem.message
        except QuadctlError as problem:
            result, reason = _FAILED, problem.message
        if reason and reason != self._reason:
            self.tell(reason)
        self._acknowledge(peer, command, result)
        self._pending.discard(key)

    def _acknowledge(self, peer: Peer, command: int, result: int) -> None:
        self._send(mavlink.MAVLink_command_ack_message(command, result, 0, 0, *peer))

    def _commands(self) -> dict[int, Callable[[Item], None]]:
        return {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda _: self._hold(),
            mavlink.MAV_CMD_DO_PAUSE_CONTINUE: self._pause,
            mavlink.MAV_CMD_NAV_LAND: lambda _: self._land(),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._return(),
            mavlink.MAV_CMD_MISSION_START: lambda _: self._start_mission(),
            mavlink.MAV_CMD_DO_FENCE_ENABLE: self._enable_fence,
            mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: self._calibrate,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda _: self._show(
                "autopilot_version"
            ),
            mavlink.MAV_CMD_GET_HOME_POSITION: lambda _: self._show("home_position"),
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
        }

    def _arm(self, item: Item) -> None:
        if item.params[0] == 1:
            if not self._view().healthy:
                raise Refused("not armed: no pose of the vehicle comes")
            self._armed = True
        elif self._view().flies:
            raise Refused("not disarmed: the vehicle flies; land first")
        else:
            self._armed = False

    def _take_off(self, item: Item) -> None:
        self._check_armed()
        place = self._view().pose.position
        if isfinite(item.z) and item.z:
            height = item.z - self._origin.altitude
        else:
            height = self._backend.parameters()["safety.takeoff"]
        goal = Position(place.x, place.y, height)
        self._pilot.begin(Errand(TAKEOFF, [Step(goal)]))

    def _reposition(self, item: Item) -> None:
        self._check_armed()
        (step,) = steps_of([_as_waypoint(item)], self._origin, self._home_place())
        self._pilot.begin(Errand(HOLD, [step]))

    def _set_mode(self, item: Item) -> None:
        mode = int(item.params[1]) << 16 | int(item.params[2]) << 24
        begin = {
            HOLD: self._hold,
            LAND: self._land,
            RETURN: self._return,
            MISSION: self._start_mission,
            TAKEOFF: lambda: self._take_off(_NO_PLACE),
        }.get(mode)
        if begin is None:
            raise Invalid(
                f"mode {mode:#x} is not flown: hold, mission, takeoff, land and return are"
            )
        begin()

    def _hold(self) -> None:
        self._pilot.end()
        self._backend.hold()

    def _pause(self, item: Item) -> None:
        if item.params[0] == 0:
            self._hold()
        else:
            raise Invalid("a pause is ended by the mode of a mission, or by a goal")

    def _land(self) -> None:
        self._hold()
        self._pilot.begin(Errand(LAND, [Step(None, lands=True)]))

    def _return(self) -> None:
        place = self._view().pose.position
        x, y = self._home
        self._pilot.begin(Errand(RETURN, [Step(Position(x, y, place.z), lands=True)]))

    def _start_mission(self) -> None:
        self._check_armed()
        steps = steps_of(self._mission, self._origin, self._home_place())
        if not steps:
            raise Refused("there is no mission: upload one first")
        self._pilot.begin(Errand(MISSION, steps))

    def _enable_fence(self, item: Item) -> None:
        if item.params[0] not in {0, 1}:
            raise Invalid("a fence is on (1) or off (0)")
        self._backend.toggle_cage(on=item.params[0] == 1)

    def _calibrate(self, item: Item) -> None:
        if item.params[2] != 1:
            raise Invalid("only the barometer is calibrated, by param3 = 1")
        self._backend.calibrate()

    def _request_message(self, item: Item) -> None:
        name = _NUMBERS.get(int(item.params[0]))
        if name is None:
            raise Invalid(f"message {item.params[0]:g} is not sent")
        self._show(name)

    def _show(self, name: str) -> None:
        self._send(getattr(self._view(), name)())

    def _set_interval(self, item: Item) -> None:
        name = _NUMBERS.get(int(item.params[0]))
        if name not in self._intervals:
            raise Invalid(f"message {item.params[0]:g} is not sent at intervals")
        microseconds = item.params[1]
        # 0 stands for the default, and a negative one turns the message off.
        self._intervals[name] = microseconds / 1e6 if microseconds else 1 / _RATES[name]

    def _get_interval(self, item: Item) -> None:
        number = int(item.params[0])
        interval = self._intervals.get(_NUMBERS.get(number, ""), 0.0)
        self._send(mavlink.MAVLink_message_interval_message(number, round(interval * 1e6)))

    def _check_armed(self) -> None:
        if not self._armed:
            raise Refused("not armed: arm first")

    # Parameters

    def _on_param_request_list(self, _m: Any, _peer: Peer, _now: float) -> None:
        self._queue(self._send_parameters)

    def _send_parameters(self) -> None:
        found = parameters.table(self._backend.parameters())
        for number, each in enumerate(found):
            self._send_parameter(each, len(found), number)

    def _send_parameter(self, each: parameters.Parameter, count: int, number: int) -> None:
        name = each.name.encode()
        self._send(mavlink.MAVLink_param_value_message(name, each.value, each.type, count, number))

    def _on_param_request_read(self, m: Any, _peer: Peer, _now: float) -> None:
        self._queue(partial(self._read_parameter, m.param_id, m.param_index))

    def _read_parameter(self, name: str, index: int) -> None:
        found = parameters.table(self._backend.parameters())
        for number, each in enumerate(found):
            if number == index or (index < 0 and each.name == name):
                self._send_parameter(each, len(found), number)

    def _on_param_set(self, m: Any, _peer: Peer, _now: float) -> None:
        self._queue(partial(self._set_parameter, m.param_id, m.param_type, m.param_value))

    def _set_parameter(self, name: str, type_: int, value: float) -> None:
        present = self._backend.parameters()
        own = next((p.own for p in parameters.table(present) if p.name == name), "")
        if not own:
            self.tell(f"there is no parameter {name}")
            return
        try:
            new = parameters.decoded(type_, value, _leaf(present, own))
            self._backend.set_parameters({own: new})
        except (QuadctlError, ValueError) as problem:
            self.tell(f"{name}: {problem}")
        # With the present value, the ground station sees what has become of its own.
        self._read_parameter(name, -1)

    # Missions and fences

    def _on_mission_count(self, m: Any, peer: Peer, now: float) -> None:
        self._transfer(m, peer, lambda kind: self._transfers.on_count(peer, kind, m.count, now))

    def _on_mission_item_int(self, m: Any, peer: Peer, now: float) -> None:
        item = Item(m.frame, m.command, (m.param1, m.param2, m.param3, m.param4), m.x, m.y, m.z)
        self._transfer(m, peer, lambda kind: self._transfers.on_item(peer, kind, m.seq, item, now))

    def _on_mission_request_list(self, m: Any, peer: Peer, _now: float) -> None:
        self._transfer(m, peer, self._transfers.on_list)

    def _on_mission_request_int(self, m: Any, peer: Peer, _now: float) -> None:
        self._transfer(m, peer, lambda kind: self._transfers.on_request(kind, m.seq))

    _on_mission_request = _on_mission_request_int

    def _on_mission_clear_all(self, m: Any, peer: Peer, _now: float) -> None:
        self._transfer(m, peer, self._transfers.on_clear)

    def _on_mission_ack(self, m: Any, peer: Peer, _now: float) -> None:
        self._transfer(m, peer, lambda kind: self._transfers.on_ack(peer, kind))

    def _transfer(self, m: Any, peer: Peer, do: Callable[[Kind], Reply | None]) -> None:
        """Do a step of a transfer of the message's kind, or of all kinds, and answer."""
        if m.mission_type == mavlink.MAV_MISSION_TYPE_ALL:
            kinds = [*Kind]
        elif m.mission_type in {*Kind}:
            kinds = [Kind(m.mission_type)]
        else:
            kinds = []
            unsupported = mavlink.MAV_MISSION_UNSUPPORTED
            self._send(mavlink.MAVLink_mission_ack_message(*peer, unsupported, m.mission_type))
        for kind in kinds:
            self._queue(partial(lambda kind: self._answer(peer, do(kind)), kind))

    def _answer(self, peer: Peer, reply: Reply | None) -> None:
        match reply:
            case Wanted(kind, number):
                self._send(mavlink.MAVLink_mission_request_int_message(*peer, number, kind))
            case Count(kind, count):
                self._send(mavlink.MAVLink_mission_count_message(*peer, count, kind))
            case Sent(kind, number, item):
                self._send(
                    mavlink.MAVLink_mission_item_int_message(
                        *peer, number, item.frame, item.command, 0, 1, *item.params,
                        item.x, item.y, item.z, kind,
                    )
                )  # fmt: skip
            case Ended(kind, result, reason):
                if reason:
                    self.tell(reason)
                self._send(mavlink.MAVLink_mission_ack_message(*peer, result, kind))

    def _load(self, kind: Kind) -> Sequence[Item]:
        return self._mission if kind == Kind.MISSION else items_of(self._zones, self._origin)

    def _save(self, kind: Kind, items: Sequence[Item]) -> None:
        if kind == Kind.MISSION:
            steps_of(items, self._origin, self._home_place())
            self._mission = list(items)
            return
        zones = zones_of(items, self._origin)
        self._backend.set_parameters({"safety.zones": [_plain(zone) for zone in zones]})

    # The rest

    def _view(self) -> View:
        if self._pose is None:
            raise Unreachable("no pose of the vehicle has come yet")
        errand = self._pilot.errand
        return View(
            self._pose,
            self._origin,
            self._home,
            errand.mode if errand else HOLD,
            self._armed,
            time.monotonic() - self._seen < _FRESH,
            lands=errand is not None and errand.lands,
        )

    def _home_place(self) -> Position:
        return Position(*self._home, 0.0)

    def _on_reached(self, number: int) -> None:
        errand = self._pilot.errand
        if errand is not None and errand.mode == MISSION:
            self._send(mavlink.MAVLink_mission_item_reached_message(number))
            following = min(number + 1, len(errand.steps) - 1)
            self._send(mavlink.MAVLink_mission_current_message(following, len(errand.steps)))

    def _on_end(self, errand: Errand, problem: QuadctlError | None) -> None:
        if problem is not None and problem.message != self._reason:
            self.tell(problem.message)
        if problem is None and errand.lands:
            self._armed = False

    def _queue(self, job: Callable[[], None]) -> None:
        with contextlib.suppress(Full):  # the ground station repeats it
            self._requests.put_nowait(job)

    def _work(self) -> None:
        while True:
            job = self._requests.get()
            try:
                job()
            except QuadctlError as problem:
                self.tell(problem.message)
            except Exception:  # noqa: BLE001 - a fault in one request must not end all later ones
                self._log.exception("a request failed")


_NO_PLACE = Item(0, 0, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0)


def _as_waypoint(item: Item) -> Item:
    return Item(item.frame, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0,) * 4, item.x, item.y, item.z)


def _leaf(values: dict[str, Any], name: str) -> Any:
    if name in values:
        return values[name]
    found: Any = values
    for part in name.split("."):
        found = found[part]
    return found


def _plain(zone: ZoneParams) -> dict[str, Any]:
    plain: dict[str, Any] = to_builtins(zone)
    return plain
