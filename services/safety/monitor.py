"""Monitor: feeds the automaton, watches the poses' age; TrackingMonitor: a vehicle's obedience."""

from collections.abc import Callable
from math import inf
from typing import cast

from msgspec.structs import astuple, replace

from quadctl.schemas.messages import (
    BodyRates,
    CageSize,
    Pose,
    Position,
    Quaternion,
    SafetyState,
    Setpoint,
    StateName,
    Velocity,
)
from quadctl.schemas.params import SafetyParams
from quadctl.services.safety.automaton import Rule, step
from quadctl.services.safety.cage import at_rest, why_outside
from quadctl.services.safety.model import (
    Booted,
    Check,
    Envelope,
    Event,
    Gone,
    Goto,
    Halted,
    Hold,
    Lagged,
    Lost,
    Resized,
    Seen,
    Situation,
    State,
    Toggle,
    World,
)

PATIENCE = 1.0
"""Time (s) at a standstill on its way to a goal after which a vehicle does not follow."""
STOOD_STILL = f"the vehicle stood still for {PATIENCE:g} s on its way"


class TrackingMonitor:
    """Check of the newest pose, at least once in a period of the setpoint.

    A setpoint answers a pose. Poses that come late, because this process or the bus was held up,
    mean that the vehicle had no setpoints: the time for which it may stand still starts anew then.
    A vehicle that was held up itself did not fly on.
    """

    def __init__(self) -> None:
        self._boot, self.stamp = "", 0.0
        """Boot and stamp (s) of the last pose."""
        self._goal: Position | None = None
        self._still_since: float | None = None

    @property
    def due(self) -> float:
        """Return the stamp (s) after which a vehicle at a standstill is at fault, else inf."""
        return inf if self._still_since is None else self._still_since + PATIENCE

    def observe(
        self, pose: Pose, goal: Position | None, *, moving: bool, setpoint_timeout: float = inf
    ) -> tuple[float, bool]:
        """Return how long (s) the vehicle had no setpoint, and whether it does not follow.

        `goal` is its present goal, None to brake; `moving` means that it is on its way. A goal that
        is new since the previous call reaches the vehicle now. Without a setpoint for longer than
        its timeout (s) the vehicle had to stand still.
        """
        same = pose.boot == self._boot and goal is not None and goal == self._goal
        gap = pose.stamp - self.stamp if same else 0.0
        self._boot, self.stamp, self._goal = pose.boot, pose.stamp, goal
        if not (same and moving and at_rest(pose)):
            self._still_since = None
        elif self._still_since is None or gap > setpoint_timeout:
            self._still_since = pose.stamp
        stuck = self._still_since is not None and pose.stamp - self._still_since > PATIENCE
        return gap, stuck


ON_THE_GROUND = 0.05
"""Height (m) below which a vehicle is on the ground."""
_ORIGIN = Position(0.0, 0.0, 0.0)
_NO_POSE = Pose(
    "", 0, 0.0, _ORIGIN, Velocity(0.0, 0.0, 0.0), Quaternion(1.0, 0.0, 0.0, 0.0),
    BodyRates(0.0, 0.0, 0.0),
)  # fmt: skip


class Monitor:
    """Decisions of safety. `on_state` is called with every new state and a line for the log."""

    def __init__(
        self,
        params: SafetyParams,
        on_state: Callable[[SafetyState, str], None],
        *,
        restarted: bool,
        grace: float,
        on_rule: Callable[[Rule], None] | None = None,
    ) -> None:
        """Start; after a restart turn the cage on, and leave the vehicle where it hovers.

        A silence within the grace (s) pauses a flight, a longer one ends it. `on_rule` is called
        with each rule taken.
        """
        self._params, self._on_state, self._restarted = params, on_state, restarted
        self._grace, self._on_rule = grace, on_rule
        self.tracking = TrackingMonitor()
        self.pose = self._last = _NO_POSE
        self.fresh, self._landing = False, ""
        self._void: set[str] = set()
        self.situation = Situation(
            state=State.HOVERING,
            goal=_ORIGIN,
            cage_on=params.cage_on or restarted,
            candidate=Goto(_ORIGIN),
        )

    def see(self, pose: Pose) -> None:
        """Take a new pose; one of another boot drops the goal and takes off again."""
        if self.ignores(pose):
            return
        same = pose.boot == self.situation.boot
        self._last, self.pose, self.fresh = self.pose if same else pose, pose, True
        if not same:
            self._boot()
        self._feed(Seen())

    def ignores(self, pose: Pose) -> bool:
        """Return whether a pose is older than the last one, or of an earlier boot."""
        late = pose.boot == self.situation.boot and pose.stamp < self.pose.stamp
        return late or pose.boot in self._void

    def watch(
        self, newest: Pose, age: float | None, setpoint_timeout: float, own: float = 0.0
    ) -> bool:
        """Stop or pause the flight if poses or setpoints are missing; return whether any were.

        `age` (s) is that of the newest pose; it is None after a delay of the caller itself, when the
        poses in its queue count first. For `own` of these seconds this process did not run.
        """
        late = age is not None and age > self._params.pose_timeout
        if age is not None and late:
            self.lose()
            self.silent(age, own)
        s = self.situation
        goal, moving = None if s.brake else s.goal, s.state is State.MOVING
        gap, stuck = self.tracking.observe(
            newest, goal, moving=moving, setpoint_timeout=setpoint_timeout
        )
        if stuck:
            self.halted(STOOD_STILL)
        elif gap > setpoint_timeout:
            self.lagged(f"the vehicle received no setpoint for {gap:.2g} s", gap)
        return late or stuck or gap > setpoint_timeout

    def lose(self) -> None:
        """Record that poses are older than allowed."""
        if self.fresh:
            self._feed(Lost(self._params.pose_timeout))
            self.fresh = False

    def silent(self, seconds: float, own: float = 0.0) -> None:
        """Record that no pose came for this long (s), up to now or up to the pose that comes now.

        Beyond the grace the flight is over. For `own` of these seconds this process did not run.
        """
        grace = max(self._grace, self._params.pose_timeout)
        if seconds > grace:
            ours = f"safety itself was held up for {own:.2g} s"
            self._feed(Gone(ours if own > grace else f"no pose for {grace:g} s"))

    def lagged(self, reason: str, seconds: float) -> None:
        """Record how long (s) the vehicle had no setpoint; beyond the grace its flight is over."""
        self._feed(Lagged(reason) if seconds <= self._grace else Halted(reason))

    def halted(self, reason: str) -> None:
        """Record that the vehicle stopped by itself: it flies on only after a new request."""
        self._feed(Halted(reason))

    def goto(self, goal: Position, *, replace: bool = False, takeoff: bool = False) -> str:
        """Request a goal; return the reason of a refusal, or an empty string."""
        self._feed(Goto(goal, replace, takeoff))
        if self.situation.state is State.VERIFYING:
            self._feed(Check())
        return self.situation.reason

    def hold(self) -> None:
        """Stop at the stopping point."""
        self._feed(Hold())

    def lands(self, why: str) -> None:
        """Stop, and refuse all goals, while the vehicle lands by itself; `why` is empty afterwards."""
        if why and why != self._landing and self.situation.boot:
            self._feed(Hold(f"stopped and landing, {why}"))
        self._landing = why

    def toggle(self, *, cage_on: bool) -> None:
        """Turn the cage on or off."""
        self._feed(Toggle(cage_on))

    def resize(self) -> None:
        """Take a change of the cage's parameters."""
        self._feed(Resized())

    def setpoint(self) -> Setpoint:
        """Return the present command to the vehicle."""
        s = self.situation
        return Setpoint(s.boot, self.pose.seq, s.goal, s.brake)

    def state(self) -> SafetyState:
        """Return the automaton's state for publication."""
        s, cage = self.situation, self._cage()
        return SafetyState(
            s.boot, self.pose.stamp, s.request, cast("StateName", s.state.name), s.goal, s.cage_on, cage, s.reason
        )  # fmt: skip

    def _boot(self) -> None:
        first = not self.situation.boot
        stays = first and self._restarted
        self._void.add(self.situation.boot)
        self._feed(Booted(self._greeting(first=first)))
        start = self.pose.position
        if self._params.takeoff > 0 and not stays and start.z < ON_THE_GROUND:
            self.goto(replace(start, z=start.z + self._params.takeoff), takeoff=True)

    def _greeting(self, *, first: bool) -> str:
        if not first:
            return "the simulation restarted: the goal is dropped"
        if self._restarted:
            return "safety restarted: hovering here, cage on"
        outside = why_outside(self.pose.position, self._cage())
        return f"the start is {outside}" if self.situation.cage_on and outside else ""

    def _feed(self, event: Event) -> None:
        before, params = self.situation, self._params
        envelope = Envelope(params.max_speed, params.max_deceleration, params.margin)
        world = World(
            self.pose, self._last, self.fresh, self._cage(), params.acceptance_range, envelope
        )
        if self._landing:
            world = replace(world, fresh=False, unready=f"the vehicle lands: {self._landing}")
        self.situation = after = step(before, event, world, on_rule=self._on_rule)
        # A change of `beyond` and `since` alone is not published.
        same = after is before or replace(after, beyond=before.beyond, since=before.since) == before
        if not same or isinstance(event, Resized):
            self._on_state(self.state(), _line(before, after, event))

    def _cage(self) -> CageSize:
        size = self._params.virtual_cage
        return CageSize(size.x, size.y, size.z)


def _line(before: Situation, after: Situation, event: Event) -> str:
    parts = []
    if isinstance(event, Goto):
        parts.append("Requested position: ({:g}, {:g}, {:g})".format(*astuple(event.goal)))
    if isinstance(event, Toggle):
        parts.append(f"Cage: {'on' if after.cage_on else 'off'}")
    if isinstance(event, Resized):
        parts.append("Parameters changed")
    if after.state is not before.state:
        parts.append(f"Current State: {after.state.name}")
    if after.reason != before.reason and after.reason:
        parts.append(after.reason)
    return ". ".join(parts)
