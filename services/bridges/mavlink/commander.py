"""Commander of one vehicle: its arming, its modes, and the missions and fences that it flies by.

All methods but `see`, `view` and the properties may call services, and block.
"""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from msgspec import Struct, to_builtins
from msgspec.structs import replace
from pymavlink.dialects.v20 import common as mavlink

from quadctl.schemas.earth import Origin
from quadctl.schemas.messages import Pose, Position, SafetyState
from quadctl.schemas.services import GotoRequest
from quadctl.schemas.typed import converted
from quadctl.schemas.zones import ZoneParams
from quadctl.services.bridges.base import BridgedVehicle
from quadctl.services.bridges.mavlink.pilot import Errand, Pilot
from quadctl.services.bridges.mavlink.plan import (
    Flyer,
    MissionStep,
    PlanItem,
    check_speed,
    items_of,
    point_of,
    steps_of,
    takeoff_of,
    zones_of,
)
from quadctl.services.bridges.mavlink.telemetry import (
    HOLD,
    LAND,
    MISSION,
    OFFBOARD,
    RETURN,
    TAKEOFF,
    View,
    flies,
)
from quadctl.services.bridges.mavlink.transfers import PlanKind
from quadctl.services.runtime.errors import Invalid, QuadctlError, Refused, Unreachable

Send = Callable[[Any], None]
_TARGET_AGE = 1.0
"""Seconds after the last target of a program at which the vehicle leaves its mode, like a PX4."""


class Unsupported(Exception):
    """Command, or part of one, that the vehicle does not have."""


class Target(Struct, frozen=True):
    """Place (m) that a program sends the vehicle to, None to stop, and when it did, monotonic s."""

    place: Position | None
    at: float

    @property
    def is_fresh(self) -> bool:
        """Return whether the program still sends targets."""
        return time.monotonic() - self.at < _TARGET_AGE


class Commander:
    """Vehicle that is flown by commands. `send` sends messages, `show` a text to all ground stations.

    Both are called from any thread; `show` gets as its second word who has the text: safety's state,
    or the reply to a request.
    """

    def __init__(
        self,
        services: BridgedVehicle,
        origin: Origin,
        send: Send,
        show: Callable[[str, str], None],
    ) -> None:
        self._services, self._origin, self._send, self._show = services, origin, send, show
        self._pose: Pose | None = None
        self._start, self._knows_start = (0.0, 0.0), False
        self._told = (0, "")
        self._plan, self._turn = threading.RLock(), threading.Lock()
        self._mission: list[PlanItem] = []
        self._next, self._is_complete = 0, False
        self._pilot = Pilot(services.fly, services.hold, self._on_reached, self._on_end)
        self._prepared: tuple[int, Callable[[], None]] | None = None
        self._target: Target | None = None
        self._ignored = ""
        self._follows: Target | None = None
        """Target that is flown to, in the mode OFFBOARD only."""
        self.armed = False
        self._commands: dict[int, Callable[[PlanItem], object]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_SET_MODE: lambda item: self.set_mode(*map(number, item.params[1:3])),
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda _: self._hold(),
            mavlink.MAV_CMD_DO_PAUSE_CONTINUE: self._pause,
            mavlink.MAV_CMD_NAV_LAND: self._land_here,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._return(),
            mavlink.MAV_CMD_MISSION_START: self._start_mission,
            mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: lambda item: self.fly_from(
                number(item.params[0])
            ),
            mavlink.MAV_CMD_DO_CHANGE_SPEED: lambda item: check_speed(
                item.params[1], self._flyer()
            ),
            mavlink.MAV_CMD_DO_FENCE_ENABLE: self._enable_fence,
            mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: self._calibrate,
        }

    def see(self, message: Pose | SafetyState) -> None:
        """Take the newest pose or state of the vehicle."""
        if isinstance(message, SafetyState):
            told = message.request, message.reason
            if message.reason and told != self._told:
                self._show(message.reason, "state")
            self._told = told
        elif self._pose is None or message.boot != self._pose.boot:
            # The first pose of a bridge that starts later is anywhere; that of a new boot is the start.
            if self._pose is not None or not self._knows_start:
                self._start = message.position.x, message.position.y
            with self._turn:
                self.armed, self._prepared, self._follows = False, None, None
            self._pilot.drop()
        self._pilot.see(message)
        if isinstance(message, Pose):
            self._pose = message
            # It takes off by itself, by `safety.takeoff`, or is flown by our own commands.
            self.armed = self.armed or flies(message)

    def learn_start(self) -> None:
        """Read where the vehicle starts: a bridge that starts later has not seen it."""
        with suppress(QuadctlError):
            self._start = self._parameter("dynamics.start.x"), self._parameter("dynamics.start.y")
            self._knows_start = True

    def do(self, item: PlanItem) -> None:
        """Execute a command; raise QuadctlError if it is refused, Unsupported for an unknown one."""
        if item.command not in self._commands:
            raise Unsupported
        self._commands[item.command](item)

    def set_mode(self, main: int, sub: int) -> None:
        """Change the mode, given by PX4's numbers; raise like `do`."""
        modes: dict[int, Callable[[], None]] = {
            HOLD: self._hold,
            LAND: self._land,
            RETURN: self._return,
            MISSION: self._fly_mission,
            TAKEOFF: lambda: self._take_off(PlanItem(0, mavlink.MAV_CMD_NAV_TAKEOFF, (0.0,) * 4)),
            OFFBOARD: self._begin_offboard,
        }
        if (mode := main << 16 | sub << 24) not in modes:
            raise Unsupported
        modes[mode]()

    def view(self, *, healthy: bool) -> View:
        """Return the vehicle in the eyes of ground stations; raise Unreachable without a pose."""
        errand = self._pilot.errand
        return View(
            self._known_pose,
            self._origin,
            self._start,
            self.mode,
            self.armed,
            healthy,
            (self._next, len(self._mission), self._mission_state()),
            lands=errand is not None and errand.lands,
        )

    @property
    def mode(self) -> int:
        """Return the mode, in PX4's numbers."""
        if errand := self._pilot.errand:
            return errand.mode
        if self._follows:
            return OFFBOARD
        return self._prepared[0] if self._prepared else HOLD

    @property
    def _known_pose(self) -> Pose:
        if self._pose is None:
            raise Unreachable("no pose of the vehicle has come yet")
        return self._pose

    # Targets of a program

    def aim(self, place: Position | None) -> None:
        """Keep a place (m) to fly to, None to stop; in the mode OFFBOARD `follow` flies there."""
        self._target, self._ignored = Target(place, time.monotonic()), ""

    def ignore(self, kind: str) -> None:
        """Keep the kind of targets that a program sends in vain, e.g. `of velocity`."""
        self._ignored = kind

    @property
    def is_due_to_follow(self) -> bool:
        """Return whether there is another target than the one that is flown to, or none any more."""
        follows, target = self._follows, self._target
        if follows is None or target is None:
            return False
        return target.place != follows.place or not target.is_fresh

    def follow(self) -> None:
        """Fly to the newest target; leave the mode if the program sends none any more."""
        before, target = self._follows, self._target
        if before is None or target is None:
            return
        if not target.is_fresh:
            self._hold()
            raise Refused(f"offboard has ended: {self._lack}")
        with self._turn:
            # A new boot, or another mode, may have ended it meanwhile.
            if self._follows is not before:
                return
            self._follows = target
        if target.place is None:
            self._services.hold()
            return
        place = target.place
        self._services.fly(GotoRequest(place.x, place.y, place.z, replace=True))

    @property
    def _lack(self) -> str:
        """Return why there is no fresh target."""
        if self._ignored:
            return f"setpoints {self._ignored} are not flown: send whole places"
        return f"no setpoint for {_TARGET_AGE:g} s: a program has to send them all the time"

    def _begin_offboard(self) -> None:
        if not self.armed:
            raise Refused("not armed: arm first")
        if self._target is None or not self._target.is_fresh:
            raise Refused(f"offboard has not begun: {self._lack}")
        self._hold()
        self._follows = Target(None, self._target.at)

    # Arming and modes

    def _arm(self, item: PlanItem) -> None:
        on = number(item.params[0], most=1) == 1
        if not on and flies(self._known_pose):
            raise Refused("not disarmed: the vehicle flies; land first")
        if not on and (self._pilot.errand or self._follows):
            self._hold()
        prepared, self._prepared = self._prepared, None
        if on and not self.armed and prepared:
            self.armed = True
            try:
                prepared[1]()
            except QuadctlError:
                self.armed = False
                raise
        self.armed = on

    def _take_off(self, item: PlanItem) -> None:
        step = takeoff_of(item, self._origin)
        if step.z is None:
            default, pose = self._parameter("safety.takeoff"), self._known_pose
            if not (default or flies(pose)):
                raise Refused("safety.takeoff is 0: give a height")
            step = replace(step, z=max(default, pose.position.z))
        self._begin(Errand(TAKEOFF, [step]))

    def _reposition(self, item: PlanItem) -> None:
        check_speed(item.params[0], self._flyer())
        step = point_of(item, self._origin)
        if not step.flies:
            # QGroundControl's pause.
            self._hold()
        elif self.armed:
            self._begin(Errand(HOLD, [step]))
        else:
            raise Refused("not armed: arm first")

    def _pause(self, item: PlanItem) -> None:
        if number(item.params[0], most=1):
            self._fly_mission()
        else:
            self._hold()

    def _begin(self, errand: Errand) -> None:
        """Fly an errand; a vehicle that is not armed keeps it until it is.

        QGroundControl sets the mode first, and then arms.
        """
        if self.armed:
            self._pilot.begin(errand)
            self._follows = None
        else:
            self._prepared = errand.mode, lambda: self._pilot.begin(errand)

    def _hold(self) -> None:
        self._prepared = self._follows = None
        self._pilot.stop()

    def _land_here(self, item: PlanItem) -> None:
        if item.has_place:
            raise Invalid("it lands where it is: fly to the place first")
        self._land()

    def _land(self) -> None:
        _ = self._known_pose  # raises without one
        self._hold()
        self._pilot.begin(Errand(LAND, [MissionStep(lands=True)]))

    def _return(self) -> None:
        if not self.armed:
            raise Refused("not armed: arm first")
        self._begin(Errand(RETURN, [MissionStep(*self._start, lands=True)]))

    def _enable_fence(self, item: PlanItem) -> None:
        self._services.toggle_cage(on=number(item.params[0], most=1) == 1)

    def _calibrate(self, item: PlanItem) -> None:
        others = (*item.params[:2], item.params[3])
        if item.params[2] != 1 or any(others) or item.has_place or item.z > 0:
            raise Unsupported
        self._services.calibrate()

    # Missions and fences

    def load(self, kind: PlanKind) -> Sequence[PlanItem]:
        """Return the items of the mission, or of the zones in force."""
        if kind == PlanKind.MISSION:
            return self._mission
        found = self._services.parameters.get("safety.zones")
        return items_of(converted(found, list[ZoneParams]), self._origin)

    def save(self, kind: PlanKind, items: Sequence[PlanItem]) -> None:
        """Take a mission, or a fence in the place of all zones; raise QuadctlError if it is refused."""
        if kind != PlanKind.MISSION:
            zones = zones_of(items, self._origin)
            self._services.parameters.set({"safety.zones": [to_builtins(zone) for zone in zones]})
            return
        steps_of(items, self._origin, self._flyer())
        with self._plan:
            if self._is_flown:
                raise Refused("the present mission is being flown: hold first")
            self._mission, self._next, self._is_complete = list(items), 0, False

    def fly_from(self, first: int) -> None:
        """Take an item for the next one; a mission that is flown goes on from there."""
        with self._plan:
            self._check_item(first)
            self._next, self._is_complete = first, False
            if self._is_flown:
                self._fly_mission()
        self._send(self.view(healthy=True).mission_current())

    def _start_mission(self, item: PlanItem) -> None:
        first, last = number(item.params[0]), item.params[1]
        if not self.armed:
            raise Refused("not armed: arm first")
        with self._plan:
            if 0 < last < len(self._mission) - 1:
                raise Invalid("a mission is flown to its end")
            self._check_item(first)
            self._next = first
            self._fly_mission()

    def _fly_mission(self) -> None:
        if not self.armed:
            self._prepared = MISSION, self._fly_mission
            return
        with self._plan:
            self._check_item(self._next)
            steps = steps_of(self._mission, self._origin, self._flyer())
            self._pilot.begin(Errand(MISSION, steps, self._next))
            self._follows = None
            self._is_complete = False

    def _check_item(self, wanted: int) -> None:
        if not self._mission:
            raise Refused("there is no mission: upload one first")
        if wanted >= len(self._mission):
            raise Refused(f"the mission has no item {wanted}")

    @property
    def _is_flown(self) -> bool:
        errand = self._pilot.errand
        return errand is not None and errand.mode == MISSION

    def _mission_state(self) -> int:
        state: int = (
            mavlink.MISSION_STATE_NO_MISSION if not self._mission
            else mavlink.MISSION_STATE_ACTIVE if self._is_flown
            else mavlink.MISSION_STATE_COMPLETE if self._is_complete
            else mavlink.MISSION_STATE_PAUSED if self._next
            else mavlink.MISSION_STATE_NOT_STARTED
        )  # fmt: skip
        return state

    def _on_reached(self, errand: Errand, step: int) -> None:
        if errand.mode == MISSION:
            self._next = (step + 1) % len(errand.steps)
            self._is_complete = not self._next
            self._send(mavlink.MAVLink_mission_item_reached_message(step))

    def _on_end(self, errand: Errand, problem: QuadctlError | None) -> None:
        if problem is not None:
            self._show(problem.message, "reply")
        elif errand.landed:
            self.armed = False

    def _flyer(self) -> Flyer:
        return Flyer(self._start, self._parameter("dynamics.control.max_speed"))

    def _parameter(self, name: str) -> float:
        value: float = self._services.parameters.get(name)
        return value


def number(value: float, most: int = 2**24) -> int:
    """Return a float as the integer that it stands for; raise Invalid for another value."""
    if not (value.is_integer() and 0 <= value <= most):
        raise Invalid(f"{value:g} is not an integer from 0 to {most}")
    return int(value)
