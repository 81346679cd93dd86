"""Safety of one simulated flight: the live monitor, fed with poses and a mission's events."""

from math import inf, isfinite

from msgspec.structs import replace

from quadctl.schemas.messages import (
    BodyRates,
    Pose,
    Position,
    Quaternion,
    SafetyState,
    Setpoint,
    Velocity,
)
from quadctl.schemas.topics import SETPOINT
from quadctl.services.campaign.mission import (
    CageEvent,
    Deaf,
    GotoEvent,
    HoldEvent,
    Jump,
    Late,
    Mission,
    Mute,
    Range,
    Resize,
    Row,
    text,
)
from quadctl.services.campaign.score import FlightLog, Point, inside
from quadctl.services.safety import cage
from quadctl.services.safety.automaton import Rule, always
from quadctl.services.safety.model import Seen, State
from quadctl.services.safety.monitor import STOOD_STILL, Monitor, TrackingMonitor

REACTION = 0.3
"""Time (s) without a pose after which a flight must have been stopped."""
_BOOT = "campaign"
_LEVEL, _STILL = Quaternion(1.0, 0.0, 0.0, 0.0), BodyRates(0.0, 0.0, 0.0)

Motion = list[float]
"""Position (m) and velocity (m/s), x, y, z each."""


class SimulatedFlight:
    """Safety's side of a flight, in periods of the setpoint."""

    def __init__(self, mission: Mission, *, log: bool = False) -> None:
        """Start before the first pose; keep log lines only with `log`."""
        self.diary = FlightLog(log=log)
        size = mission.safety.virtual_cage
        self.cage_on, self.size = mission.safety.cage_on, (size.x, size.y, size.z)
        """The cage as commanded."""
        self.mute_until = self.last_sent = 0.0
        """End of the vehicle's silence of setpoints (s), and time of the last one before."""
        self.params = replace(mission.safety, virtual_cage=replace(size))
        self.monitor = Monitor(
            self.params, self._on_state, restarted=False, grace=mission.dynamics.grace,
            on_rule=self._on_rule,
        )  # fmt: skip
        self._following = TrackingMonitor()
        self._rows, self._next = mission.rows, 0
        self._blind_until = self._faulty_at = self._pose_at = 0.0
        self.seen = -1
        """The period of the last pose that was shown."""

    @property
    def wanted(self) -> float:
        """Return the period in which the monitor must run whatever the vehicle does."""
        is_faulty = self.diary.now <= max(self._blind_until, self.mute_until, self._faulty_at)
        if is_faulty or self.monitor.situation.paused:
            return 0
        return self._rows[self._next].at * SETPOINT.hz if self._next < len(self._rows) else inf

    @property
    def due(self) -> float:
        """Return the period in which the vehicle is at fault, if it is at a standstill until then."""
        # One period early, against rounding.
        return self._following.due * SETPOINT.hz - 1

    @property
    def returning(self) -> float:
        """Return the time (s) from which a vehicle outside must not go out again; inf for none."""
        s = self.monitor.situation
        return s.since + cage.REACTION if s.cage_on and 0 < s.beyond < inf else inf

    def see(self, period: int, motion: Motion) -> None:
        """Show a pose to safety, unless poses are lost."""
        self.seen = period
        self.diary.now = period / SETPOINT.hz
        if self.diary.now >= self._blind_until:
            self._show(_pose(period, motion))

    def skip(self, period: int, motion: Motion) -> None:
        """Take a pose that changes nothing, without a step of the automaton."""
        self.seen = period
        self.monitor.pose = _pose(period, motion)

    def track(self, period: int, motion: Motion) -> None:
        """Take a pose only to find out how long the vehicle stands still on its way."""
        goal = self.monitor.situation.goal
        self._following.observe(_pose(period, motion), goal, moving=True)

    def act(self, period: int, motion: Motion) -> bool:
        """Carry out the events that are due; return whether the cage in force has changed."""
        changed = False
        while self._next < len(self._rows) and self._rows[self._next].at * SETPOINT.hz <= period:
            row = self._rows[self._next]
            self._next += 1
            if self.diary.log:
                self.diary.add_line(text(row))
            before = self.cage_on, self.size
            self._do(row, period, motion)
            changed |= before != (self.cage_on, self.size)
        # A sleeping monitor has seen no poses, so a gap means nothing here.
        moving = self.monitor.situation.state is State.MOVING
        goal = self.monitor.situation.goal
        if self._following.observe(self.monitor.pose, goal, moving=moving)[1]:
            self.monitor.halted(STOOD_STILL)
        age = self.diary.now - self._pose_at
        if age > self.params.pose_timeout:
            self.monitor.lose()
            self.monitor.silent(age)
        if age > REACTION and self.monitor.state().state == "MOVING":
            self.diary.violated(f"MOVING {REACTION:g} s after the last pose")
        return changed

    def setpoint(self) -> Setpoint:
        """Return the present setpoint."""
        setpoint = self.monitor.setpoint()
        if not setpoint.brake:
            self._expect_permitted(setpoint.position, "sent")
        return setpoint

    def _do(self, row: Row, period: int, motion: Motion) -> None:
        match row:
            case GotoEvent(_, x, y, z, change):
                reason = self.monitor.goto(Position(x, y, z), replace=change)
                self.diary.requested((x, y, z), reason)
                if not reason and self.diary.now - self._pose_at > REACTION:
                    self.diary.violated(f"a goal was taken {REACTION:g} s after the last pose")
            case HoldEvent():
                self.monitor.hold()
            case CageEvent(_, on):
                self.cage_on = on
                self.monitor.toggle(cage_on=on)
            case Resize(_, x, y, z):
                self.size = x, y, z
                cage = self.params.virtual_cage
                cage.x, cage.y, cage.z = x, y, z
                self.monitor.resize()
            case Range(_, metres):
                self.params.acceptance_range = metres
                self.monitor.resize()
            case _:
                self._fail(row, period, motion)

    def _fail(self, row: Deaf | Mute | Jump | Late, period: int, motion: Motion) -> None:
        self._faulty_at = self.diary.now
        match row:
            case Deaf(at, seconds):
                self._blind_until = at + seconds
            case Mute(at, seconds):
                if self.diary.now >= self.mute_until:
                    self.last_sent = self.diary.now - 1 / SETPOINT.hz
                self.mute_until = max(self.mute_until, at + seconds)
            case Jump(_, x, y, z):
                self._show(
                    _pose(period, [motion[0] + x, motion[1] + y, motion[2] + z, *motion[3:]])
                )
            case Late(_, age):
                before = self.monitor.pose
                late = _pose(max(period - round(age * SETPOINT.hz), 0), motion)
                self._show(late)
                if self.monitor.pose.stamp < before.stamp:
                    self.diary.violated("an old pose was taken")

    def _show(self, pose: Pose) -> None:
        if not self.monitor.ignores(pose):
            # A sleeping monitor has missed no pose.
            if self._blind_until > self._pose_at:
                self.monitor.silent(self.diary.now - self._pose_at)
            self._pose_at = self.diary.now
            self.monitor.see(pose)

    def _on_state(self, state: SafetyState, line: str) -> None:
        self.diary.published(state, line)
        if state.state == "MOVING":
            self._expect_permitted(state.goal, "MOVING")

    def _on_rule(self, rule: Rule) -> None:
        """Count a rule, but not a pose that changes nothing: a sleeping monitor misses some."""
        if rule.when is not always or rule.on is not Seen:
            self.diary.guards[str(rule)] += 1

    def _expect_permitted(self, goal: Position, how: str) -> None:
        place: Point = (goal.x, goal.y, goal.z)
        if self.cage_on:
            if not inside(place, self.size):
                self.diary.violated(f"{how} to a goal outside with the cage on")
        elif not (all(map(isfinite, place)) and goal.z >= 0.0):
            self.diary.violated(f"{how} to an invalid goal")


def _pose(period: int, motion: Motion) -> Pose:
    # The automaton uses neither attitude nor body rates.
    x, y, z, vx, vy, vz = motion
    stamp = period / SETPOINT.hz
    return Pose(_BOOT, period, stamp, Position(x, y, z), Velocity(vx, vy, vz), _LEVEL, _STILL)
