"""Safety of one simulated flight: the live monitor, fed with poses and a mission's events.

Each decision that a fault or a goal demands is judged here a second time, apart from safety's code.
"""

from collections.abc import Callable
from math import dist, inf, isfinite
from typing import Any

from msgspec.structs import astuple, replace

from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Quaternion,
    SafetyState,
    Setpoint,
    Velocity,
)
from quadctl.schemas.params import DynamicsParams, Params, SafetyParams
from quadctl.schemas.services import SetParamsRequest
from quadctl.schemas.topics import SETPOINT
from quadctl.services.airspace import stopping
from quadctl.services.airspace.geometry import Point, place_of, velocity_of
from quadctl.services.airspace.stopping import StoppingLaw
from quadctl.services.airspace.zones import Region
from quadctl.services.campaign.mission import (
    CageEvent,
    Deaf,
    Fault,
    GotoEvent,
    HoldEvent,
    Jump,
    Late,
    Mission,
    Mute,
    Param,
    Range,
    Reboot,
    Resize,
    Row,
    Runaway,
    Stall,
    Stuck,
    faults_of,
    text,
)
from quadctl.services.campaign.score import FlightLog, inside
from quadctl.services.runtime.params.live import LiveParams
from quadctl.services.safety import automaton
from quadctl.services.safety.automaton import Rule, always
from quadctl.services.safety.model import Seen, State
from quadctl.services.safety.monitor import Monitor
from quadctl.services.safety.motion import responded, stop_law
from quadctl.services.safety.traffic import Traffic

REACTION = 0.3
"""Time (s) without a pose after which a flight must have been stopped."""
STANDSTILL = 1.3
"""Time (s) at a standstill on its way after which a vehicle must have been stopped."""
REST = 1.0
"""Time (s) after which a vehicle at rest must be at the goal that safety publishes."""
NEAR = 0.3
"""Distance (m) from that goal that still counts as there."""
ON_FLOOR = 0.02
"""Height (m) below which a vehicle has landed, in still air."""
DEPTH = 0.01
"""Distance (m) that a sound vehicle in still air may come into a zone."""
PERIOD = 1 / SETPOINT.hz
ROUNDING = 1e-9
_STOPS = (automaton.stop, automaton.stop_pose_jump)
_LEVEL, _STILL = Quaternion(1.0, 0.0, 0.0, 0.0), BodyRates(0.0, 0.0, 0.0)

Motion = list[float]
"""Position (m) and velocity (m/s), x, y, z each."""


class SimulatedFlight:
    """Safety's side of a flight, in periods of the setpoint."""

    def __init__(
        self,
        mission: Mission,
        *,
        log: bool = False,
        name: str = "uav",
        traffic: Traffic | None = None,
    ) -> None:
        """Start before the first pose; keep log lines only with `log`.

        The vehicle of that name keeps apart from the others of its traffic.
        """
        self.diary = FlightLog(log=log)
        size = mission.safety.virtual_cage
        self.cage_on, self.size = mission.safety.cage_on, (size.x, size.y, size.z)
        """The cage as commanded."""
        self.mute_until = self.last_sent = 0.0
        """End of the vehicle's silence of setpoints (s), and time of the last one before."""
        self.astray_until: float = 0.0
        self.astray_to: Point | None = None
        """End of the time (s) in which the vehicle ignores its setpoints and flies there, m."""
        self.params = replace(mission.safety, virtual_cage=replace(size))
        self.monitor = Monitor(
            self.params, self._on_state, restarted=False, grace=mission.dynamics.grace,
            on_rule=self._on_rule, name=name, traffic=traffic,
        )  # fmt: skip
        self._traffic = traffic
        self._region = Region(self.params.zones)
        self.served: dict[str, LiveParams] = {}
        """Live parameters by the name of their node, if any change in flight."""
        if any(isinstance(row, Param) for row in mission.rows):
            params = Params(safety=self.params)
            self.served["safety"] = serve("safety", params, self.monitor.resize)
        self._timeout, self._grace = mission.dynamics.setpoint_timeout, mission.dynamics.grace
        faults, wind = faults_of(mission.rows), mission.dynamics.wind
        disturbed = any((wind.mean.x, wind.mean.y, wind.gust)) or any(
            isinstance(row, Param) and row.name.startswith(("dynamics.wind", "dynamics.fault"))
            for row in mission.rows
        )
        self.sound = not faults
        """True if nothing fails in this flight."""
        self.healthy = self.sound and not disturbed
        """True if nothing fails, and the air is still."""
        self._departure = Departure(self.params, self.monitor) if "Runaway" in faults else None
        self.fly_with(mission.dynamics)
        self._rows, self._next = mission.rows, 0
        self._boot = "campaign"
        self._error: Point | None = None
        self._blind_until = self._stalled_until = self._faulty_at = self._pose_at = 0.0
        self._still_since = 0.0
        self._still_goal: Point | None = None
        self._rule = automaton.RULES[0]
        """Rule that the last pose took."""
        self._motion = [0.0] * 6
        self._missed, self._was_moving = 0.0, False
        """Time (s) without a pose up to this one, and whether the flight was MOVING then."""
        self.seen = -1
        """The period of the last pose that was shown."""

    def fly_with(self, params: DynamicsParams) -> None:
        """Tell safety with which parameters the vehicle flies."""
        self.monitor.set_vehicle(params.vehicle, params.control, params.wind)

    @property
    def is_astray(self) -> bool:
        """Return whether the vehicle ignores its setpoints."""
        return self.diary.now < self.astray_until

    @property
    def _awoke(self) -> bool:
        """Return whether safety's process ran again only now."""
        return 0 < self._stalled_until > self.diary.now - PERIOD

    @property
    def _blindness(self) -> float:
        """Return how long (s) safety's process has run without a pose."""
        return self.diary.now - max(self._pose_at, self._stalled_until)

    @property
    def wanted(self) -> float:
        """Return the period in which the monitor must run whatever the vehicle does."""
        s = self.monitor.situation
        if self.params.zones or (self._traffic and self._traffic.is_shared):
            return 0  # the loop over all vehicles knows neither zones nor other vehicles
        if s.cage_on and 0 < s.beyond < inf:
            return 0  # nor how much nearer a vehicle outside has come
        if not self.sound:
            until = max(self._blind_until, self._stalled_until, self.mute_until, self.astray_until)
            # One more period, in which setpoints arrive again.
            late = self.diary.now - PERIOD <= max(until, self._faulty_at)
            if late or s.paused:
                return 0
        return self._rows[self._next].at * SETPOINT.hz if self._next < len(self._rows) else inf

    @property
    def due(self) -> float:
        """Return the period in which the vehicle is at fault, if it is at a standstill until then."""
        # One period early, against rounding.
        return self.monitor.tracking.due * SETPOINT.hz - 1

    def see(self, period: int, motion: Motion) -> None:
        """Show a pose to safety, unless poses are lost."""
        self.seen, self._motion = period, motion
        self.diary.now = period / SETPOINT.hz
        if not self.sound:
            if self.diary.now < max(self._blind_until, self._stalled_until):
                return
            if self._error:
                x, y, z = self._error
                self._error = None
                motion = [motion[0] + x, motion[1] + y, motion[2] + z, *motion[3:]]
        self._show(self._pose(period, motion))
        if self._region and self.healthy:
            self._expect_outside_zones()

    def _expect_outside_zones(self) -> None:
        s, place = self.monitor.situation, place_of(self.monitor.pose)
        # A zone that came upon the vehicle may keep it for a while.
        if s.cage_on and s.beyond == 0 and (deep := self._region.excess(place, place)) > DEPTH:
            self.diary.violated(f"the vehicle was {1000 * deep:.1f} mm inside a zone")

    def skip(self, period: int, motion: Motion) -> None:
        """Take a pose that changes nothing, without a step of the automaton."""
        self.seen = period
        self.monitor.pose = self._pose(period, motion)

    def track(self, period: int, motion: Motion) -> None:
        """Take a pose only to find out how long the vehicle stands still on its way."""
        s = self.monitor.situation
        goal, moving = None if s.brake else s.goal, s.state is State.MOVING
        self.monitor.tracking.observe(self._pose(period, motion), goal, moving=moving)

    def act(self, period: int) -> bool:
        """Carry out the events that are due; return whether the cage in force has changed."""
        if self.diary.now < self._stalled_until:
            return False
        changed, first = False, self._next
        while self._next < len(self._rows) and self._rows[self._next].at * SETPOINT.hz <= period:
            row = self._rows[self._next]
            if self._next == first and self.healthy:
                self._expect_at_goal()
            self._next += 1
            if self.diary.log:
                self.diary.add_line(text(row))
            before = self.cage_on, self.size
            self._do(row, period)
            changed |= before != (self.cage_on, self.size)
        # After a stall the poses that have queued up count first.
        age = None if not self.sound and self._awoke else self.diary.now - self._pose_at
        self.monitor.watch(self.monitor.pose, age, self._timeout)
        if not self.sound:
            self._expect_stops(acted=self._next > first)
        return changed

    def setpoint(self) -> Setpoint:
        """Return the present setpoint."""
        setpoint = self.monitor.setpoint()
        if not setpoint.brake:
            self._expect_permitted(setpoint.position, "sent")
        return setpoint

    def _do(self, row: Row, period: int) -> None:
        match row:
            case GotoEvent(_, x, y, z, change):
                reason = self.monitor.goto(Position(x, y, z), replace=change)
                self.diary.requested((x, y, z), reason)
                if not reason and self._blindness > REACTION:
                    self.diary.violated(f"a goal was taken {REACTION:g} s after the last pose")
                if reason.startswith(("outside the cage", "below")) and self._permits((x, y, z)):
                    self.diary.violated("a goal inside was refused")
                if not reason and self._departure and self._departure.allowed == inf:
                    self._confine()
            case HoldEvent():
                self.monitor.hold()
            case CageEvent(_, on):
                self.cage_on = on
                self.monitor.toggle(cage_on=on)
                self._confine()
            case Resize(_, x, y, z):
                self.size = x, y, z
                cage = self.params.virtual_cage
                cage.x, cage.y, cage.z = x, y, z
                self.monitor.resize()
                self._confine()
            case Range(_, metres):
                self.params.acceptance_range = metres
                self.monitor.resize()
                self._confine()
            case Param(_, name, value):
                answer = self.served[name.partition(".")[0]].set(SetParamsRequest({name: value}))
                self.diary.add_line(answer.reason)
                cage = self.params.virtual_cage
                self.size = cage.x, cage.y, cage.z
                self._confine()
            case _:
                self._fail(row, period)

    def _fail(self, row: Fault, period: int) -> None:
        now = self._faulty_at = self.diary.now
        match row:
            case Deaf(at, seconds):
                self._blind_until = at + seconds
            case Mute(at, seconds):
                self._silence(at + seconds)
            case Stall(at, seconds):
                self._stalled_until = at + seconds
                self._silence(at + seconds)
            case Stuck(at, seconds):
                self.astray_until, self.astray_to = at + seconds, None
            case Runaway(at, seconds, x, y, z):
                self.astray_until, self.astray_to = at + seconds, (x, y, z)
            case Reboot():
                old = self._pose(period + 1, self._motion)
                self._boot += "'"
                self._show(self._pose(period, self._motion))
                self._show(old)
                if self.monitor.pose.boot == old.boot:
                    self.diary.violated("a pose of a boot that is over was taken")
                self._confine()
            case Jump(_, x, y, z):
                self._error = x, y, z
                self._faulty_at = now + PERIOD
            case Late(_, age):
                before = self.monitor.pose
                self._show(self._pose(max(period - round(age * SETPOINT.hz), 0), self._motion))
                if self.monitor.pose.stamp < before.stamp:
                    self.diary.violated("an old pose was taken")

    def _silence(self, end: float) -> None:
        """Let no setpoint reach the vehicle until a time, s."""
        if self.diary.now >= self.mute_until:
            self.last_sent = self.diary.now - PERIOD
        self.mute_until = max(self.mute_until, end)

    def _show(self, pose: Pose) -> None:
        if self.monitor.ignores(pose):
            return
        before, first = self.monitor.pose, pose.boot != self.monitor.situation.boot
        # A sleeping monitor has missed no pose.
        if not self.sound and max(self._blind_until, self._stalled_until) > self._pose_at:
            self._missed = self.diary.now - self._pose_at
            stalled = self._stalled_until > self._pose_at
            self._was_moving = self.monitor.situation.state is State.MOVING
            self.monitor.silent(self._missed, self._missed if stalled else 0.0)
        self._pose_at = self.diary.now
        self.monitor.see(pose)
        if first:
            self._confine()
        elif not self.sound or self._rule.do in _STOPS:
            self._judge_pose(before, pose)

    def _judge_pose(self, before: Pose, pose: Pose) -> None:
        jumped, stopped = self._rule.do is automaton.stop_pose_jump, self._rule.do in _STOPS
        if self.sound:
            if self.healthy:
                self.diary.violated("a sound vehicle was stopped on its way out of the cage")
            return
        way = dist(astuple(pose.position), astuple(before.position))
        most = self.params.max_speed * (pose.stamp - before.stamp) + self.monitor.margin
        if abs(way - most) > ROUNDING and jumped is not (way > most):
            self.diary.violated(
                "a sound pose was taken for a jump" if jumped else "a jump of the pose was missed"
            )
        if self._departure and self.cage_on:
            if not stopped and self._departure.is_due(pose, self.size):
                self.diary.violated("the vehicle left the cage, and safety did not stop it")
            if stopped:
                self._departure.allowed = inf
            elif self._rule.when is always:
                self._departure.returned(self.size)

    def _confine(self) -> None:
        """Allow the vehicle to stop as far outside as it now has to."""
        if self._departure and self.cage_on:
            self._departure.confine(self.size)

    def _permits(self, place: Point) -> bool:
        return (
            inside(place, self.size)
            if self.cage_on
            else all(map(isfinite, place)) and place[2] >= 0
        )

    def _expect_at_goal(self) -> None:
        s, pose = self.monitor.situation, self.monitor.pose
        since = max(self.monitor.moved, self.diary.changed_at)
        rest = max(REST, self.monitor.stop.settling)
        rests = s.state is State.HOVERING and self.diary.now - since > rest
        if rests and dist(s.goal, place_of(pose)) > NEAR:
            self.diary.violated("it rests away from the goal that safety publishes")
        lands = self.healthy and not s.brake and s.goal[2] <= 0.0
        if rests and lands and pose.position.z > ON_FLOOR:
            self.diary.violated("it hovers at the end of a landing")

    def _expect_stops(self, *, acted: bool) -> None:
        s, now = self.monitor.situation, self.diary.now
        moving = s.state is State.MOVING
        if moving and self._blindness > REACTION:
            self.diary.violated(f"MOVING {REACTION:g} s after the last pose")
        if moving and self._was_moving and not acted:
            if self._missed > self._grace + PERIOD:
                self.diary.violated(f"MOVING after {self._grace:g} s without a pose")
            if self._missed > self._timeout + PERIOD and not s.reason:
                self.diary.violated("a pause was not reported")
        # A vehicle without setpoints has to stand still: its time starts anew then.
        stopped = self._awoke or self._missed > self._timeout
        self._missed, self._was_moving = 0.0, False
        # In periods with a fault this sees every pose.
        still = moving and self.wanted == 0 and stopping.at_rest(self.monitor.pose)
        goal = s.goal if still and not stopped else None
        if goal is None or goal != self._still_goal:
            self._still_since, self._still_goal = now, goal
        elif now - self._still_since > STANDSTILL:
            self.diary.violated(f"MOVING after {STANDSTILL:g} s at a standstill")

    def _on_state(self, state: SafetyState, line: str) -> None:
        self.diary.published(state, line)
        if state.state == "MOVING":
            self._expect_permitted(state.goal, "MOVING")

    def _on_rule(self, rule: Rule) -> None:
        """Count a rule, but not a pose that changes nothing: a sleeping monitor misses some."""
        if rule.on is Seen:
            self._rule = rule
        if rule.when is not always or rule.on is not Seen:
            self.diary.fired.append(rule)

    def _expect_permitted(self, goal: Position, how: str) -> None:
        if not self._permits((goal.x, goal.y, goal.z)):
            kind = "a goal outside with the cage on" if self.cage_on else "an invalid goal"
            self.diary.violated(f"{how} to {kind}")

    def _pose(self, period: int, motion: Motion) -> Pose:
        # The automaton uses neither attitude nor body rates.
        x, y, z, vx, vy, vz = motion
        stamp = period / SETPOINT.hz
        place, speed = Position(x, y, z), Velocity(vx, vy, vz)
        return Pose(self._boot, period, stamp, place, speed, _LEVEL, _STILL)


def serve(
    node: str, params: Params, changed: Callable[[], None], in_force: Callable[[], Any] = dict
) -> LiveParams:
    """Return a node's live parameters, as `quadctl param set` sets them; no file keeps them."""
    return LiveParams(node, params, lambda _: None, changed, in_force)


class Departure:
    """How far outside the cage (m) a vehicle may come to a stop before safety has to stop it."""

    def __init__(self, params: SafetyParams, monitor: Monitor) -> None:
        """Start without a limit; the vehicle brakes as gently as the monitor allows for."""
        self.allowed = inf
        self._params, self._monitor = params, monitor

    def is_due(self, pose: Pose, size: Point) -> bool:
        """Return whether the vehicle can no longer stop within the limit and the margin."""
        # Written once more: safety's own may be what is wrong.
        k, t = 0.5 / self._params.max_deceleration, self._params.reaction
        motion = zip(place_of(pose), velocity_of(pose), strict=True)
        x, y, z = (p + t * v + k * v * abs(v) for p, v in motion)
        limit = self.allowed + self._monitor.margin + ROUNDING
        return stopping.outside(x, y, z, *size) > limit

    def confine(self, size: Point) -> None:
        """Set the limit when the cage changes."""
        world = self._monitor.world()
        self.allowed = self._leeway(size, stop_law(self._monitor.situation, world))

    def returned(self, size: Point) -> None:
        """Lower the limit for a vehicle that has come nearer."""
        if self.allowed < inf:
            s, world = self._monitor.situation, self._monitor.world()
            law = stop_law(s, world)
            law = law.steady if responded(s, world) else law
            self.allowed = min(self.allowed, self._leeway(size, law))

    def _leeway(self, size: Point, law: StoppingLaw) -> float:
        return stopping.leeway(self._monitor.pose, CageSize(*size), Region(), law)


def _motion(pose: Pose) -> Motion:
    return [*place_of(pose), *velocity_of(pose)]
