"""Safety automaton: what a vehicle's safety does on each event. Pure: no clock, bus or file.

    HOVERING -> VERIFYING -> MOVING -> HOVERING

Theory of operation. `step` takes the situation (all that is remembered), an event, and the world (the
newest pose, the cage, the zones, other vehicles), and returns the next situation. RULES is the whole
table: in a state, on an event, the first rule with a condition that holds says which state is next, and
which action makes the situation. A request is VERIFYING between Goto, which takes it up, and Check, which
brings the verdict of `verify` in motion.py: so a flight goes on until another goal is accepted, and a
refusal changes nothing but the reason.

The three states are the lab's. Behind them is a `FlightPhase`. TAKING_OFF and FLYING are MOVING. The
others are HOVERING: HOLDING after an arrival; STOPPING from an order to brake to the first pose at rest,
then STOPPED; PAUSED is a stop after which the flight goes on. In the last three the setpoint is the order
to brake: it has the place where the order was given, and once STOPPED the place of rest.

A way around zones has several legs. `goal` is the end of the present one, to which the setpoint leads;
`end`, that of the whole way, is published. The next leg begins once the vehicle has settled (`rest_of`):
it has been at rest at the corner for as long as it takes to respond.

The guard of the path, `straying`, compares the soonest stop with `beyond`: how far outside the vehicle may
come to rest. Inside, that is 0. It is set anew when the cage changes, at each boot and, if it is infinite,
with an accepted goal: to how far a sound vehicle comes that must stop. It falls as the vehicle comes
nearer. It is infinite once a guard has stopped the vehicle, so that a guard reports once.

Silences: without poses a flight is PAUSED (Lost), and over beyond the grace (Gone). Without setpoints the
vehicle brakes by itself: within the grace it flies on (Lagged), later its flight is over (Halted).

What the table covers: requests and their refusals; the cage, switched or resized in flight; guards on
each pose (a jump, a stop that would end outside); silences of poses and setpoints; stops and new boots.

What it does not: when an event happens. The monitor measures silences, asks for the verdict, keeps a goal
that waits for other vehicles, and lets the vehicle give way to them. Nor does it fly: the setpoint is the
present goal, or the order to brake, and dynamics flies there.
"""

from collections.abc import Callable, Iterable
from math import dist, inf
from typing import NamedTuple

from msgspec.structs import replace

from quadctl.schemas.messages import PAUSED
from quadctl.services.airspace.geometry import place_of
from quadctl.services.airspace.routes import rise
from quadctl.services.airspace.stopping import at_rest
from quadctl.services.safety.model import (
    Booted,
    Check,
    Event,
    FlightPhase,
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
from quadctl.services.safety.motion import (
    Rest,
    motion,
    responded,
    rest_of,
    stop_law,
    why_excluded,
)


def keep(s: Situation, _e: Event, _w: World) -> Situation:
    """Change nothing."""
    return s


def consider(s: Situation, e: Event, _w: World) -> Situation:
    """Take a request up for verification."""
    assert isinstance(e, Goto)  # noqa: S101 - RULES pairs this action with Goto alone
    # The present flight continues until the request is accepted.
    return replace(_unpaused(s), request=s.request + 1, candidate=e, reason="")


def take(s: Situation, e: Event, w: World) -> Situation:
    """Fly to the candidate, leg by leg; from outside, go no farther out than necessary."""
    assert isinstance(e, Check)  # noqa: S101 - RULES pairs this action with Check alone
    assert s.candidate  # noqa: S101 - it is VERIFYING
    phase, route = _flight(s.candidate), e.verdict.route
    goal, *corners = route.points
    s = s if s.beyond < inf else _caged(s, w)
    s = replace(s, origin=route.origin, reach=route.reach, goal=goal, corners=tuple(corners))
    s = replace(s, legs=len(route.points) if corners else 0, commanded=w.pose.stamp)
    return replace(s, phase=phase, candidate=None, reason="")


def turn(s: Situation, e: Event, w: World) -> Situation:
    """Fly on, and from rest at a corner along the next leg."""
    assert s.corners  # noqa: S101 - RULES pairs this action with `cornering`
    if rest_of(s, w) is not Rest.SETTLED:
        return follow(s, e, w)
    goal, *corners = s.corners
    s = replace(s, origin=s.goal, reach=rise(s.goal, goal), commanded=w.pose.stamp)
    return replace(s, goal=goal, corners=tuple(corners))


def follow(s: Situation, _e: Event, w: World) -> Situation:
    """Fly or hover on; a vehicle that comes nearer from outside must not go back out."""
    if not s.cage_on or not 0 < s.beyond < inf:
        return s
    # On its way to a goal inside, or to its stop, it speeds up outwards only at first.
    law = stop_law(s, w)
    out = w.leeway(law.steady if responded(s, w) else law)
    return replace(s, beyond=out) if out < s.beyond else s


def refuse(s: Situation, e: Event, _w: World) -> Situation:
    """Refuse the candidate, with the reason of the verdict."""
    assert isinstance(e, Check)  # noqa: S101 - RULES pairs this action with Check alone
    return replace(s, candidate=None, reason=e.verdict.why)


def refuse_busy(s: Situation, _e: Event, _w: World) -> Situation:
    """Refuse a goal while another one is being flown."""
    x, y, z = s.end
    reason = f"busy: flying to ({x:g}, {y:g}, {z:g}); ask with replace to change course"
    return replace(s, request=s.request + 1, reason=reason)


def refuse_blind(s: Situation, _e: Event, w: World) -> Situation:
    """Refuse a goal without a pose, or while the vehicle lands by itself."""
    reason = w.unready
    if s.paused:
        reason = f"{PAUSED}{reason}; no goal is taken during a pause"
    return replace(s, request=s.request + 1, reason=reason)


def pause(s: Situation, e: Event, w: World) -> Situation:
    """Brake to the stopping point, until poses come again."""
    assert isinstance(e, Lost)  # noqa: S101 - RULES pairs this action with Lost alone
    after = _stopped(s, w, f"{PAUSED}no pose for {e.limit:g} s")
    after = replace(after, reach=s.reach, corners=s.corners, legs=s.legs, phase=FlightPhase.PAUSED)
    return replace(after, paused=Goto(s.goal, takeoff=s.phase is FlightPhase.TAKING_OFF))


def resume(s: Situation, _e: Event, w: World) -> Situation:
    """Fly on to the goal of the paused flight."""
    assert s.paused is not None  # noqa: S101 - RULES pairs this action with `paused`
    s = replace(s, phase=_flight(s.paused), goal=s.paused.goal, commanded=w.pose.stamp)
    return replace(s, paused=None, reason=f"went on after a pause: {s.reason.removeprefix(PAUSED)}")


def note(s: Situation, e: Event, _w: World) -> Situation:
    """Report that the flight paused; it has resumed already."""
    assert isinstance(e, Lagged)  # noqa: S101 - RULES pairs this action with Lagged alone
    return replace(s, reason=f"went on after a pause: {e.reason}")


def arrive(s: Situation, _e: Event, _w: World) -> Situation:
    """Hold the goal, ready for the next one."""
    return replace(s, phase=FlightPhase.HOLDING, reason="", legs=0)


def stop(s: Situation, e: Event, w: World) -> Situation:
    """Brake to the stopping point, with the reason."""
    match e:
        case Lost(seconds):
            reason = f"no pose for {seconds:g} s: stopped"
        case Gone(why):
            reason = f"{why}: stopped"
        case Halted(why):
            reason = f"stopped, {why}"
        case Hold(reason):
            pass
        case Seen():
            where = "out of the cage or into a zone" if w.region else "out of the cage"
            reason = f"stopped, the path led {where} by {w.stopping_excess():.2g} m"
        case _:
            done = "hovering in place" if s.state is State.HOVERING else "stopped"
            reason = f"{done}, {why_excluded(s, w)}"
    after = _stopped(s, w, reason)
    # A guard reports once that a vehicle leaves; it can do nothing more.
    return replace(after, beyond=inf) if isinstance(e, Seen) else after


def stop_pose_jump(s: Situation, _e: Event, w: World) -> Situation:
    """Brake to the stopping point, because the vehicle cannot be at its pose."""
    seconds = w.pose.stamp - w.last.stamp
    reason = f"stopped, the pose jumped by {_moved(w):.3g} m in {seconds:.3g} s"
    return replace(_stopped(s, w, reason), beyond=inf)


def settle(s: Situation, _e: Event, w: World) -> Situation:
    """End a stop: the goal is the place where it ended."""
    return replace(s, goal=w.place, phase=FlightPhase.STOPPED)


def toggle(s: Situation, e: Event, w: World) -> Situation:
    """Turn the cage on or off."""
    assert isinstance(e, Toggle)  # noqa: S101 - RULES pairs this action with Toggle alone
    return _caged(replace(_end_pause(s), cage_on=e.cage_on), w)


def toggle_and_stop(s: Situation, e: Event, w: World) -> Situation:
    """Turn the cage on, and stop, because the goal is now outside."""
    return stop(toggle(s, e, w), e, w)


def resize(s: Situation, _e: Event, w: World) -> Situation:
    """Fly or hover on within new bounds."""
    return _caged(_end_pause(s), w)


def resize_and_stop(s: Situation, e: Event, w: World) -> Situation:
    """Stop, because the goal is outside the new bounds."""
    return stop(resize(s, e, w), e, w)


def reboot(s: Situation, e: Event, w: World) -> Situation:
    """Drop the goal, and stay where the new boot is."""
    assert isinstance(e, Booted)  # noqa: S101 - RULES pairs this action with Booted alone
    s = _stopped(_caged(s, w), w, e.reason)
    return replace(s, boot=w.pose.boot, phase=FlightPhase.STOPPED, commanded=-inf)


def _flight(request: Goto) -> FlightPhase:
    return FlightPhase.TAKING_OFF if request.takeoff else FlightPhase.FLYING


def _caged(s: Situation, w: World) -> Situation:
    """Allow the vehicle to come to rest as far outside the cage as it now has to."""
    return replace(s, beyond=w.leeway(stop_law(s, w)))


def _stopped(s: Situation, w: World, reason: str) -> Situation:
    s = replace(s, reach=motion(s), corners=(), legs=0, commanded=w.pose.stamp, goal=w.place)
    return replace(s, phase=FlightPhase.STOPPING, candidate=None, paused=None, reason=reason)


def _end_pause(s: Situation) -> Situation:
    ended = "stopped, the cage was changed during a pause"
    return replace(_unpaused(s), reason=ended) if s.paused else s


def _unpaused(s: Situation) -> Situation:
    """Return the situation without a paused flight, which still brakes."""
    if not s.paused:
        return s
    return replace(s, phase=FlightPhase.STOPPING, paused=None, reach=motion(s), corners=(), legs=0)


def _moved(w: World) -> float:
    """Return how far (m) the vehicle has moved since the last pose."""
    return dist(w.place, place_of(w.last))


def always(_s: Situation, _e: Event, _w: World) -> bool:
    """Return True: the row applies if no row above it does."""
    return True


def blind(_s: Situation, _e: Event, w: World) -> bool:
    """Return whether there is no pose to rely on."""
    return not w.fresh


def may_replace(s: Situation, e: Event, _w: World) -> bool:
    """Return whether the present flight may be replaced: a take-off, or on request."""
    return s.phase is FlightPhase.TAKING_OFF or (isinstance(e, Goto) and e.replace)


def permitted(_s: Situation, e: Event, _w: World) -> bool:
    """Return whether the verdict on the candidate is that it may be flown to."""
    return isinstance(e, Check) and not e.verdict.why


def from_flight(s: Situation, _e: Event, _w: World) -> bool:
    """Return whether the request came while another goal was being flown."""
    return s.flies and s.candidate is not None


def arrived(s: Situation, _e: Event, w: World) -> bool:
    """Return whether the vehicle is within the acceptance range of its goal."""
    return dist(w.place, s.goal) < w.params.acceptance_range


def barred(s: Situation, e: Event, w: World) -> bool:
    """Return whether the present cage excludes the vehicle's present goal.

    A vehicle within the acceptance range still flies on to its goal, but not one that stops.
    """
    cage_on = e.cage_on if isinstance(e, Toggle) else s.cage_on
    return cage_on and not s.brake and bool(why_excluded(s, w))


def cornering(s: Situation, _e: Event, _w: World) -> bool:
    """Return whether the vehicle flies a leg that is not the last."""
    return bool(s.corners)


def settled(s: Situation, _e: Event, w: World) -> bool:
    """Return whether a stop was commanded and the vehicle has come to rest."""
    return s.stops and at_rest(w.pose)


def paused(s: Situation, _e: Event, _w: World) -> bool:
    """Return whether a flight waits for poses."""
    return s.paused is not None


def jumped(_s: Situation, _e: Event, w: World) -> bool:
    """Return whether this pose is too far from the previous one for the vehicle's speed."""
    seconds = w.pose.stamp - w.last.stamp
    return _moved(w) > w.params.max_speed * seconds + w.margin


def straying(s: Situation, _e: Event, w: World) -> bool:
    """Return whether, with the cage on, the vehicle can no longer stop inside or in `beyond`."""
    return s.cage_on and w.stopping_excess() > s.beyond + w.margin


class Rule(NamedTuple):
    """Transition: in a state, on an event, if a condition holds, to a state, by an action."""

    at: State
    on: type[Event]
    when: Callable[[Situation, Event, World], bool]
    to: State
    do: Callable[[Situation, Event, World], Situation]

    def __str__(self) -> str:
        return f"{self.at.name} {self.on.__name__} {self.when.__name__}"


HOVERING, VERIFYING, MOVING = State

# The first rule that fits is taken. Every (state, event) has one that always fits (tested).
# fmt: off
RULES = (
    #    at         on       when         to         do
    Rule(HOVERING,  Goto,    blind,       HOVERING,  refuse_blind),
    Rule(HOVERING,  Goto,    always,      VERIFYING, consider),
    Rule(HOVERING,  Check,   always,      HOVERING,  keep),
    Rule(HOVERING,  Seen,    jumped,      HOVERING,  stop_pose_jump),
    Rule(HOVERING,  Seen,    straying,    HOVERING,  stop),
    Rule(HOVERING,  Seen,    paused,      MOVING,    resume),
    Rule(HOVERING,  Seen,    settled,     HOVERING,  settle),
    Rule(HOVERING,  Seen,    always,      HOVERING,  follow),
    Rule(HOVERING,  Lost,    always,      HOVERING,  keep),
    Rule(HOVERING,  Gone,    paused,      HOVERING,  stop),
    Rule(HOVERING,  Gone,    always,      HOVERING,  keep),
    Rule(HOVERING,  Lagged,  always,      HOVERING,  keep),
    Rule(HOVERING,  Halted,  always,      HOVERING,  keep),
    Rule(HOVERING,  Booted,  always,      HOVERING,  reboot),
    Rule(HOVERING,  Hold,    always,      HOVERING,  stop),
    Rule(HOVERING,  Toggle,  barred,      HOVERING,  toggle_and_stop),
    Rule(HOVERING,  Toggle,  always,      HOVERING,  toggle),
    Rule(HOVERING,  Resized, barred,      HOVERING,  resize_and_stop),
    Rule(HOVERING,  Resized, always,      HOVERING,  resize),
    Rule(VERIFYING, Check,   permitted,   MOVING,    take),
    Rule(VERIFYING, Check,   barred,      HOVERING,  stop),
    Rule(VERIFYING, Check,   from_flight, MOVING,    refuse),
    Rule(VERIFYING, Check,   always,      HOVERING,  refuse),
    Rule(VERIFYING, Goto,    always,      VERIFYING, refuse_busy),
    Rule(VERIFYING, Seen,    always,      VERIFYING, keep),
    Rule(VERIFYING, Lost,    always,      HOVERING,  stop),
    Rule(VERIFYING, Gone,    always,      HOVERING,  stop),
    Rule(VERIFYING, Lagged,  always,      VERIFYING, keep),
    Rule(VERIFYING, Halted,  always,      HOVERING,  stop),
    Rule(VERIFYING, Booted,  always,      HOVERING,  reboot),
    Rule(VERIFYING, Hold,    always,      HOVERING,  stop),
    Rule(VERIFYING, Toggle,  always,      VERIFYING, toggle),
    Rule(VERIFYING, Resized, always,      VERIFYING, resize),
    Rule(MOVING,    Goto,    blind,       MOVING,    refuse_blind),
    Rule(MOVING,    Goto,    may_replace, VERIFYING, consider),
    Rule(MOVING,    Goto,    always,      MOVING,    refuse_busy),
    Rule(MOVING,    Check,   always,      MOVING,    keep),
    Rule(MOVING,    Seen,    jumped,      HOVERING,  stop_pose_jump),
    Rule(MOVING,    Seen,    straying,    HOVERING,  stop),
    Rule(MOVING,    Seen,    cornering,   MOVING,    turn),
    Rule(MOVING,    Seen,    arrived,     HOVERING,  arrive),
    Rule(MOVING,    Seen,    always,      MOVING,    follow),
    Rule(MOVING,    Lost,    always,      HOVERING,  pause),
    Rule(MOVING,    Gone,    always,      HOVERING,  stop),
    Rule(MOVING,    Lagged,  always,      MOVING,    note),
    Rule(MOVING,    Halted,  always,      HOVERING,  stop),
    Rule(MOVING,    Booted,  always,      HOVERING,  reboot),
    Rule(MOVING,    Hold,    always,      HOVERING,  stop),
    Rule(MOVING,    Toggle,  barred,      HOVERING,  toggle_and_stop),
    Rule(MOVING,    Toggle,  always,      MOVING,    toggle),
    Rule(MOVING,    Resized, barred,      HOVERING,  resize_and_stop),
    Rule(MOVING,    Resized, always,      MOVING,    resize),
)
# fmt: on


Table = dict[tuple[State, type[Event]], tuple[Rule, ...]]


def by_place(rules: Iterable[Rule]) -> Table:
    """Return the rules for each state and event, in their order."""
    table: Table = {}
    for rule in rules:
        table[rule.at, rule.on] = (*table.get((rule.at, rule.on), ()), rule)
    return table


_TABLE = by_place(RULES)


def step(
    situation: Situation,
    event: Event,
    world: World,
    rules: tuple[Rule, ...] = RULES,
    on_rule: Callable[[Rule], None] | None = None,
) -> Situation:
    """Return the situation after an event; pure. Raise LookupError if no rule fits.

    `on_rule` is called with the rule taken.
    """
    table = _TABLE if rules is RULES else by_place(rules)
    for rule in table.get((situation.state, type(event)), ()):
        if rule.when(situation, event, world):
            if on_rule is not None:
                on_rule(rule)
            after = rule.do(situation, event, world)
            assert after.state is rule.to, f"{rule} leads to {after.state}"  # noqa: S101 - RULES has it
            return after
    raise LookupError(f"no rule for {situation.state} and {event}")
