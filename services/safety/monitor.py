"""Monitor: feeds the automaton, watches the poses' age; TrackingMonitor: a vehicle's obedience."""

from collections import deque
from collections.abc import Callable
from copy import deepcopy
from math import inf
from typing import cast

from msgspec.structs import astuple, replace

from quadctl.schemas.messages import (
    WAITS,
    BodyRates,
    CageSize,
    NearestWall,
    Pose,
    Position,
    Quaternion,
    SafetyState,
    Setpoint,
    StateName,
    Velocity,
    Zone,
    Zones,
)
from quadctl.schemas.params import SafetyParams, SeparationParams, WindParams
from quadctl.schemas.vehicle import ControlParams, VehicleParams
from quadctl.services.airspace.airworthiness import settled, stopping_law, wind_margin
from quadctl.services.airspace.cage import why_outside
from quadctl.services.airspace.geometry import Point, place_of
from quadctl.services.airspace.separation import NOBODY, Others, conflicts, why_near
from quadctl.services.airspace.stopping import PATIENCE, StoppingLaw, at_rest
from quadctl.services.airspace.zones import Region, nearest
from quadctl.services.safety.automaton import Rule, step
from quadctl.services.safety.model import (
    Booted,
    Check,
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
    Toggle,
    World,
)
from quadctl.services.safety.motion import is_quiet, reserved, space_after, verify
from quadctl.services.safety.traffic import Held, Post, Traffic

WAIT = 30.0
"""Simulated time (s) for which a goal waits while no vehicle ahead of it is on its way."""
_WINDS = 50
"""Winds that are remembered of a few seconds, the longest one among them."""
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
        self._goal: Point | None = None
        self._needs_setpoints = False
        self._still_since: float | None = None

    @property
    def due(self) -> float:
        """Return the stamp (s) after which a vehicle at a standstill is at fault, else inf."""
        return inf if self._still_since is None else self._still_since + PATIENCE

    def observe(
        self, pose: Pose, goal: Point | None, *, moving: bool, setpoint_timeout: float | None = inf
    ) -> tuple[float, bool]:
        """Return how long (s) the vehicle had no setpoint, and whether it does not follow.

        `goal` is its present goal, None to brake; `moving` means that it is on its way. A goal that
        is new since the previous call reaches the vehicle now. Without a setpoint for longer than
        its timeout (s) the vehicle had to stand still; at rest, without a timeout, it needs none.
        """
        same = pose.boot == self._boot and goal is not None and goal == self._goal
        needs = setpoint_timeout is not None
        before, self._needs_setpoints = self._needs_setpoints, needs
        gap = pose.stamp - self.stamp if same and before and needs else 0.0
        self._boot, self.stamp, self._goal = pose.boot, pose.stamp, goal
        if not (same and moving and at_rest(pose)):
            self._still_since = None
        elif self._still_since is None or gap > (setpoint_timeout or inf):
            self._still_since = pose.stamp
        stuck = self._still_since is not None and pose.stamp - self._still_since > PATIENCE
        return gap, stuck


ON_THE_GROUND = 0.05
"""Height (m) below which a vehicle is on the ground."""
_ORIGIN = (0.0, 0.0, 0.0)
_NO_POSE = Pose(
    "", 0, 0.0, Position(*_ORIGIN), Velocity(0.0, 0.0, 0.0), Quaternion(1.0, 0.0, 0.0, 0.0),
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
        name: str = "",
        traffic: Traffic | None = None,
        post: Post = lambda item: item(),
    ) -> None:
        """Start; after a restart turn the cage on, and leave the vehicle where it hovers.

        A silence within the grace (s) pauses a flight, a longer one ends it. `on_rule` is called
        with each rule taken. The vehicle of that name keeps apart from the others of its traffic;
        `post` runs a function on its loop.
        """
        self._params, self._on_state, self._restarted = params, on_state, restarted
        self._grace, self._on_rule = grace, on_rule
        self.tracking = TrackingMonitor()
        self.pose = self._last = _NO_POSE
        self.fresh, self._landing = False, ""
        self.takes_off = False
        """True while a take-off after a boot is still to come; a request replaces it."""
        self._quiet: bool | None = False
        """True if, since the last event, a pose like the newest one changes nothing; None if nobody asked yet."""
        self.moved = -inf
        """Stamp (s) of the last pose of this boot in motion."""
        self._flown = self._stop = stopping_law(VehicleParams(), ControlParams(), WindParams())
        self._blown = self._most_blown = 0.0
        """Margin (m) for the present wind, and the widest for winds and their changes since the last boot."""
        self._winds: deque[tuple[float, WindParams]] = deque()
        """Winds that the vehicle may still be tilted against, each with the stamp (s) of its beginning."""
        self._void: set[str] = set()
        self._zones, self._region = params.zones, Region(params.zones)
        self.situation = Situation(_ORIGIN, cage_on=params.cage_on or restarted)
        self.name = name
        self.held: Held | None = None
        self._led = 0.0
        """Stamp (s) at which a vehicle ahead of the goal that waits was last on its way."""
        self._traffic = traffic or Traffic()
        self._traffic.join(self, post)

    @property
    def separation(self) -> SeparationParams:
        """Return its distance from others."""
        return self._params.separation

    def see(self, pose: Pose) -> bool:
        """Take a new pose; one of another boot drops the goal and takes off again.

        Return False if it can change nothing, nor what is near: the vehicle rests where it was.
        """
        if self.ignores(pose):
            return False
        before = self.situation
        same = pose.boot == before.boot
        repeats = same and _is_same_motion(pose, self.pose) and self._find_quiet()
        self._last, self.pose, self.fresh = self.pose if same else pose, pose, True
        if repeats:
            return False
        if not at_rest(pose):
            self.moved = pose.stamp
        elif not same:
            self.moved = -inf
        if not same:
            self._boot()
        world = self.world()
        self._feed(Seen(), world)
        self._traffic.watch(self, world)
        if self.held:
            self._retry(self.held)
        self._quiet = None if self.situation is before and not self.held else False
        return True

    def _find_quiet(self) -> bool:
        if self._quiet is None:
            self._quiet = is_quiet(self.situation, self.world())
        return self._quiet

    def ignores(self, pose: Pose) -> bool:
        """Return whether a pose is older than the last one, or of an earlier boot."""
        late = pose.boot == self.situation.boot and pose.stamp < self.pose.stamp
        return late or pose.boot in self._void

    def watch(
        self, newest: Pose, age: float | None, setpoint_timeout: float | None, own: float = 0.0
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
        goal, moving = None if s.brake else s.goal, s.flies
        gap, stuck = self.tracking.observe(
            newest, goal, moving=moving, setpoint_timeout=setpoint_timeout
        )
        lags = gap > (setpoint_timeout or inf)
        if stuck:
            self.halted(STOOD_STILL)
        elif lags:
            self.lagged(f"the vehicle received no setpoint for {gap:.2g} s", gap)
        return late or stuck or lags

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
            reason = ours if own > grace else f"no pose for {grace:g} s"
            self._feed(Gone(reason))
            self._wait_no_more(reason)

    def lagged(self, reason: str, seconds: float) -> None:
        """Record how long (s) the vehicle had no setpoint; beyond the grace its flight is over."""
        self._feed(Lagged(reason) if seconds <= self._grace else Halted(reason))

    def halted(self, reason: str) -> None:
        """Record that the vehicle stopped by itself: it flies on only after a new request."""
        self._feed(Halted(reason))

    def goto(
        self,
        goal: Position,
        *,
        replace: bool = False,
        takeoff: bool = False,
        direct: bool = False,
        wait: bool = False,
    ) -> str:
        """Request a goal; return the reason of a refusal, or an empty string.

        The way is a `direct` one, or leads around zones that bar it. With `wait` a goal waits for
        vehicles that are about to leave its way; the reason then begins with `waits`.
        """
        self.takes_off = False
        with self._traffic.lock:
            self._feed(Goto(astuple(goal), replace, takeoff))
            self._verify(direct=direct, wait=wait)
            return self.situation.reason

    def _verify(self, *, direct: bool, wait: bool, number: int = 0) -> None:
        """Verify the candidate, if any; with `wait` it may wait, with its `number` if it has done so before."""
        s = self.situation
        if s.candidate is None:
            return
        world = self.world(self._traffic.others(self.name, before=number or None))
        verdict, held = verify(s, s.candidate, world, direct=direct), None
        if wait and verdict.near and not s.flies:
            held = self._traffic.hold(
                self.name, verdict.route.ahead, verdict.near, direct=direct, number=number
            )
        if held:
            verdict = replace(verdict, why=f"{WAITS}{verdict.why}")
        self._feed(Check(verdict), world)
        if self.situation.reason.startswith(WAITS):
            self.held = held
            self._led = self._led if number else self.pose.stamp

    def _retry(self, held: Held) -> None:
        """Fly to the goal that waits once its way is free; refuse it once that cannot be."""
        with self._traffic.lock:
            if self._traffic.leads(self.name):
                self._led = self.pose.stamp
            elif self.pose.stamp - self._led > WAIT:
                self._wait_no_more(f"no vehicle ahead of it has moved on for {WAIT:g} s")
                return
            world = self.world()
            space = space_after(self.situation, held.points, world)
            for only in (held.first, ""):
                others = self._traffic.others(self.name, only=only, before=held.number)
                near = conflicts(world.place, space, others)
                again = near and self._traffic.hold(
                    self.name, held.points, near, direct=held.direct, number=held.number
                )
                if again:
                    self.held = held if only else again
                    return
            self._feed(Goto(held.points[-1]))
            self._verify(direct=held.direct, wait=True, number=held.number)

    def hold(self) -> None:
        """Stop at the stopping point; a goal that waits is dropped."""
        self.takes_off = False
        self._feed(Hold())

    def _wait_no_more(self, reason: str) -> None:
        """Drop the goal that waits, if any, with a reason: nobody may wait behind it any longer."""
        if self.held:
            self._feed(Hold(f"the goal waits no more, {reason}"))

    def give_way(self, reason: str) -> None:
        """Stop the flight, because another vehicle comes too near."""
        if self.situation.flies:
            self._feed(Hold(reason))

    def recheck(self, only: str = "") -> None:
        """Stop the flight if another vehicle, or the `only` one, is on its way by now."""
        if not self.situation.flies:
            return
        with self._traffic.lock:
            world = self.world(self._traffic.others(self.name, only=only, before=0))
            space = reserved(self.situation, world)
            if near := conflicts(world.place, space, world.others):
                self.give_way(f"stopped, {why_near(near)}")

    def set_landing(self, why: str) -> None:
        """Stop, and refuse all goals, while the vehicle lands by itself, e.g. in a wind that it cannot hold.

        `why` is empty afterwards: then only a new request makes it fly.
        """
        if why and why != self._landing and self.situation.boot:
            self._feed(Hold(f"stopped and landing, {why}"))
        self._landing = why

    def set_vehicle(self, vehicle: VehicleParams, control: ControlParams, wind: WindParams) -> None:
        """Take the body, gains and limits that the vehicle flies with, and its wind."""
        flies, now = (vehicle, control, wind), self.pose.stamp
        # A change in several steps, an axis after the other, moves it as one does.
        while len(self._winds) > 1 and self._winds[1][0] < now - settled(control):
            self._winds.popleft()
        before, blown = (
            [earlier for _, earlier in self._winds if earlier != wind],
            wind_margin(*flies),
        )
        changed = wind_margin(*flies, before) if before else blown
        self.set_stop(stopping_law(*flies), blown, changed)
        if not (self._winds and self._winds[-1][1] == wind):
            if len(self._winds) == _WINDS:
                del self._winds[1]
            self._winds.append((now, deepcopy(wind)))

    def set_stop(self, law: StoppingLaw, blown: float, changed: float = 0.0) -> None:
        """Take the law of the vehicle's stop, and the margins (m) for its wind and for a change to it in flight.

        The law counts from the vehicle's next standstill, and an earlier wind may have moved it: until the
        next boot, safety counts with the wider of all since the last.
        """
        self._quiet = False
        self._flown, self._stop = law, law.wider(self._stop)
        self._blown, self._most_blown = blown, max(blown, changed, self._most_blown)

    def toggle(self, *, cage_on: bool) -> None:
        """Turn the cage on or off."""
        self._feed(Toggle(cage_on))

    def resize(self) -> None:
        """Take a change of the cage's parameters, or of the distance from others."""
        self._feed(Resized())
        self.recheck()

    def setpoint(self) -> Setpoint:
        """Return the present command to the vehicle."""
        s = self.situation
        return Setpoint(s.boot, self.pose.seq, Position(*s.goal), s.brake)

    def state(self) -> SafetyState:
        """Return the automaton's state for publication."""
        s, cage = self.situation, CageSize(*astuple(self._params.virtual_cage))
        state = SafetyState(
            s.boot, self.pose.stamp, s.request, cast("StateName", s.state.name), Position(*s.end), s.cage_on, cage, s.reason
        )  # fmt: skip
        wall = self.nearest()
        return replace(state, leg=s.leg, legs=s.legs, nearest=wall)

    def nearest(self) -> NearestWall:
        """Return the nearest wall in force; no name with the cage off, or before the first pose."""
        if not (self.situation.cage_on and self.situation.boot):
            return NearestWall()
        wall = nearest(place_of(self.pose), self._params.virtual_cage, self._zones_in_force())
        return NearestWall(*wall, wall.distance <= self._params.warn_within)

    @property
    def zones(self) -> Zones:
        """Return the zones in force while the cage is on."""
        return Zones(tuple(map(Zone.of, self._params.zones)))

    def _boot(self) -> None:
        first = not self.situation.boot
        self._stop, self._most_blown = self._flown, self._blown
        self._winds = deque((-inf, wind) for _, wind in [*self._winds][-1:])
        stays = first and self._restarted
        self._void.add(self.situation.boot)
        self._feed(Booted(self._greeting(first=first)))
        self._traffic.moved(self.name)
        low = self.pose.position.z < ON_THE_GROUND
        self.takes_off = self._params.takeoff > 0 and low and not stays
        if self.takes_off and not self._traffic.begins:
            self.take_off()

    def take_off(self) -> None:
        """Take off after a boot."""
        start = self.pose.position
        goal = replace(start, z=start.z + self._params.takeoff)
        self.goto(goal, takeoff=True, direct=True)

    def _greeting(self, *, first: bool) -> str:
        if not first:
            return "the simulation restarted: the goal is dropped"
        if self._restarted:
            return "safety restarted: hovering here, cage on"
        outside = why_outside(place_of(self.pose), self._params.virtual_cage)
        return f"the start is {outside}" if self.situation.cage_on and outside else ""

    def _feed(self, event: Event, world: World | None = None) -> None:
        before, world = self.situation, world or self.world()
        self._quiet = False
        if self._landing:
            world = replace(world, fresh=False, unready=f"the vehicle lands: {self._landing}")
        self.situation = after = step(before, event, world, on_rule=self._on_rule)
        if not after.reason.startswith(WAITS):
            # A guard, a fault or another request, also one that is refused: the goal that waits must not
            # fly off later by itself.
            self.held = None
        # A change of `beyond` alone is not published.
        same = after is before or replace(after, beyond=before.beyond) == before
        if not same or isinstance(event, Resized):
            self._on_state(self.state(), _line(before, after, event))

    @property
    def stop(self) -> StoppingLaw:
        """Return the law of the vehicle's stop."""
        p = self._params
        return self._stop.declared(p.reaction, p.max_acceleration, p.min_deceleration)

    @property
    def margin(self) -> float:
        """Return the tolerance (m) of the vehicle's motion, the widest for the wind since the last boot."""
        return self._params.margin + self._most_blown

    def world(self, others: Others = NOBODY) -> World:
        """Return the automaton's input, with the newest pose."""
        return World(
            self.pose, self._last, self.fresh, self._params, self.stop, self.margin,
            region=self._zones_in_force(), others=others, rested=self.pose.stamp - self.moved,
        )  # fmt: skip

    def _zones_in_force(self) -> Region:
        if self._params.zones is not self._zones:
            self._zones, self._region = self._params.zones, Region(self._params.zones)
        return self._region


def _is_same_motion(pose: Pose, last: Pose) -> bool:
    return pose.position == last.position and pose.velocity == last.velocity


def _line(before: Situation, after: Situation, event: Event) -> str:
    parts = []
    if isinstance(event, Goto):
        parts.append("Requested position: ({:g}, {:g}, {:g})".format(*event.goal))
    if isinstance(event, Toggle):
        parts.append(f"Cage: {'on' if after.cage_on else 'off'}")
    if isinstance(event, Resized):
        parts.append("Parameters changed")
    if after.state is not before.state:
        parts.append(f"Current State: {after.state.name}")
    if after.reason != before.reason and after.reason:
        parts.append(after.reason)
    return ". ".join(parts)
