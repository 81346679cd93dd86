"""Monitor: feeds the automaton; TrackingMonitor: detects a vehicle that does not follow."""

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
from quadctl.services.safety.automaton import step
from quadctl.services.safety.cage import at_rest, why_outside
from quadctl.services.safety.model import (
    Ask,
    Booted,
    Check,
    Envelope,
    Event,
    Gone,
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
"""A vehicle that stands still for so long (s) on its way to a goal does not follow."""
STANDS = f"the vehicle stood still for {PATIENCE:g} s on its way"


class TrackingMonitor:
    """Looks at the newest pose at least once in a period of the setpoint.

    A setpoint answers a pose. Poses that come only after a while, because this process or the bus
    was held up, show a vehicle that meanwhile heard nothing; one that was held up itself has not
    flown on either.
    """

    def __init__(self) -> None:
        self._boot, self._stamp = "", 0.0
        self._goal: Position | None = None
        self._still_since: float | None = None

    @property
    def due(self) -> float:
        """The stamp (s) beyond which a vehicle that now stands still on its way is in trouble, else inf."""
        return inf if self._still_since is None else self._still_since + PATIENCE

    def observe(self, pose: Pose, goal: Position | None, *, moving: bool) -> tuple[float, bool]:
        """Return for how long (s) the vehicle has heard nothing, and whether it does not follow.

        `goal` is what it is told, None to brake; `moving` says that it is on its way. A goal that is
        new since the last look is heard now.
        """
        same = pose.boot == self._boot and goal is not None and goal == self._goal
        gap = pose.stamp - self._stamp if same else 0.0
        self._boot, self._stamp, self._goal = pose.boot, pose.stamp, goal
        if not (same and moving and at_rest(pose)):
            self._still_since = None
        elif self._still_since is None:
            self._still_since = pose.stamp
        stands = self._still_since is not None and pose.stamp - self._still_since > PATIENCE
        return gap, stands


ON_THE_GROUND = 0.05
"""A vehicle lower than this (m) stands on the ground."""
_ORIGIN = Position(0.0, 0.0, 0.0)
_NO_POSE = Pose(
    "", 0, 0.0, _ORIGIN, Velocity(0.0, 0.0, 0.0), Quaternion(1.0, 0.0, 0.0, 0.0),
    BodyRates(0.0, 0.0, 0.0),
)  # fmt: skip


class Monitor:
    """Safety's decisions. `tell` hears of every new state, with a line for the log."""

    def __init__(
        self,
        params: SafetyParams,
        tell: Callable[[SafetyState, str], None],
        *,
        restarted: bool,
        grace: float,
    ) -> None:
        """After a restart the cage is on, and the vehicle is left where it hovers.

        A silence that is over within the grace (s) pauses a flight, a longer one ends it.
        """
        self._params, self._tell, self._restarted = params, tell, restarted
        self._grace = grace
        self.pose = self._last = _NO_POSE
        self.fresh = False
        self._void: set[str] = set()
        self.situation = Situation(
            state=State.HOVERING,
            goal=_ORIGIN,
            cage_on=params.cage_on or restarted,
            candidate=Ask(_ORIGIN),
        )

    def see(self, pose: Pose) -> None:
        """Take a new pose; one of another boot voids the goal and takes off anew."""
        if self.ignores(pose):
            return
        same = pose.boot == self.situation.boot
        self._last, self.pose, self.fresh = self.pose if same else pose, pose, True
        if not same:
            self._boot()
        self._feed(Seen())

    def ignores(self, pose: Pose) -> bool:
        """Whether a pose is of the past: older than the last one, or of a boot that is over."""
        late = pose.boot == self.situation.boot and pose.stamp < self.pose.stamp
        return late or pose.boot in self._void

    def lose(self) -> None:
        """Poses are older than allowed."""
        if self.fresh:
            self._feed(Lost(self._params.pose_timeout))
            self.fresh = False

    def silent(self, seconds: float, own: float = 0.0) -> None:
        """No pose has come for this long (s), or none had before one that comes now.

        Beyond the grace the flight is over. For `own` of these seconds this process did not run.
        """
        grace = max(self._grace, self._params.pose_timeout)
        if seconds > grace:
            ours = f"safety itself stood still for {own:.2g} s"
            self._feed(Gone(ours if own > grace else f"no pose for {grace:g} s"))

    def lagged(self, reason: str, seconds: float) -> None:
        """The vehicle has heard no setpoint for this long (s); beyond the grace its flight is over."""
        self._feed(Lagged(reason) if seconds <= self._grace else Halted(reason))

    def halted(self, reason: str) -> None:
        """The vehicle has stopped by itself: it goes on only where somebody asks anew."""
        self._feed(Halted(reason))

    def ask(self, goal: Position, *, replace: bool = False, takeoff: bool = False) -> str:
        """Request a goal; returns why it is refused, empty when it is taken."""
        self._feed(Ask(goal, replace, takeoff))
        if self.situation.state is State.VERIFYING:
            self._feed(Check())
        return self.situation.reason

    def hold(self) -> None:
        """Stop at the stopping point."""
        self._feed(Hold())

    def toggle(self, *, cage_on: bool) -> None:
        """Turn the cage on or off."""
        self._feed(Toggle(cage_on))

    def resize(self) -> None:
        """The cage's parameters have changed."""
        self._feed(Resized())

    def setpoint(self) -> Setpoint:
        """What the vehicle is to do now."""
        s = self.situation
        return Setpoint(s.boot, self.pose.seq, s.goal, s.brake)

    def state(self) -> SafetyState:
        """The automaton as others may know it."""
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
            self.ask(replace(start, z=start.z + self._params.takeoff), takeoff=True)

    def _greeting(self, *, first: bool) -> str:
        if not first:
            return "the simulation started anew: the goal is dropped"
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
        self.situation = after = step(before, event, world)
        if after is before and not isinstance(event, Resized):
            return
        # How far from outside it has come is nobody else's concern.
        if replace(after, beyond=before.beyond, since=before.since) != before or isinstance(
            event, Resized
        ):
            self._tell(self.state(), _line(before, after, event))

    def _cage(self) -> CageSize:
        size = self._params.virtual_cage
        return CageSize(size.x, size.y, size.z)


def _line(before: Situation, after: Situation, event: Event) -> str:
    parts = []
    if isinstance(event, Ask):
        parts.append("Requested position: ({:g}, {:g}, {:g})".format(*astuple(event.goal)))
    if isinstance(event, Toggle | Resized):
        parts.append(f"Cage: {'on' if after.cage_on else 'off'}")
    if after.state is not before.state:
        parts.append(f"Current State: {after.state.name}")
    if after.reason != before.reason and after.reason:
        parts.append(after.reason)
    return ". ".join(parts)
