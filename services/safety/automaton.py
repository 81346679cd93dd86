"""Safety automaton: RULES, conditions, actions and step(). All state changes are in this file.

    HOVERING -> VERIFYING -> MOVING -> HOVERING

`step` is pure: the pose, the cage and the results of timeouts come in with the event and the world.
"""

from collections.abc import Callable, Iterable
from math import dist, inf, isfinite
from typing import NamedTuple

from msgspec.structs import astuple, replace

from quadctl.schemas.messages import PAUSED, WAITS
from quadctl.services.safety.cage import (
    REACTION,
    at_rest,
    caged,
    leeway,
    stopping_excess,
    why_below,
    why_outside,
)
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
    State,
    Toggle,
    World,
)
from quadctl.services.safety.separation import why_near
from quadctl.services.safety.way import (
    LOW,
    is_there,
    motion,
    rise,
    too_near,
    way_to,
    why_barred,
    why_stopped,
)


def keep(s: Situation, _e: Event, _w: World) -> Situation:
    """Change nothing."""
    return s


def consider(s: Situation, e: Event, _w: World) -> Situation:
    """Take a request up for verification."""
    assert isinstance(e, Goto)  # noqa: S101 - RULES pairs this action with Goto alone
    # The present flight continues until the request is accepted.
    return replace(_ended(s), request=s.request + 1, candidate=e, back=s.state, reason="")


def take(s: Situation, e: Event, w: World) -> Situation:
    """Fly to the candidate, leg by leg; from outside, go no farther out than necessary."""
    assert isinstance(e, Check)  # noqa: S101 - RULES pairs this action with Check alone
    way = way_to(s, s.candidate.goal, e.corners if s.cage_on else (), w)
    goal, *corners = way.points
    s = s if s.beyond < inf else caged(s, w)
    s = replace(s, origin=way.origin, reach=way.reach, corners=tuple(corners))
    s = replace(s, leg=1 if corners else 0, legs=len(way.points) if corners else 0)
    s = replace(s, commanded=w.pose.stamp, takeoff=s.candidate.takeoff)
    return replace(s, goal=goal, brake=False, settling=False, reason="")


def turn(s: Situation, e: Event, w: World) -> Situation:
    """Fly on, and from rest at a corner along the next leg."""
    assert s.corners  # noqa: S101 - RULES pairs this action with `cornering`
    if not is_there(s, w):
        return follow(s, e, w)
    goal, *corners = s.corners
    s = replace(s, origin=s.goal, reach=rise(s.goal, goal), commanded=w.pose.stamp)
    return replace(s, goal=goal, corners=tuple(corners), leg=s.leg + 1)


def follow(s: Situation, _e: Event, w: World) -> Situation:
    """Fly or hover on; a vehicle that comes nearer from outside must not go back out."""
    if not s.cage_on or not 0 < s.beyond < inf or w.pose.stamp < s.since + REACTION:
        return s
    out = leeway(w)
    return replace(s, beyond=out) if out < s.beyond else s


def refuse(s: Situation, e: Event, w: World) -> Situation:
    """Refuse a goal below the floor, barred by the cage or a zone, or too near a vehicle."""
    goal = s.candidate.goal
    barred = (why_outside(goal, w.cage) or _why_zoned(s, e, w)) if s.cage_on else why_below(goal)
    if barred:
        return replace(s, reason=barred)
    waits = isinstance(e, Check) and e.waits
    near = f"{WAITS if waits else ''}{_why_near(s, e, w)}"
    # A goal that is no number is in no cage, on or off.
    return replace(s, reason=near or why_outside(goal, w.cage))


def _why_near(s: Situation, e: Event, w: World) -> str:
    """Return which vehicle the way to the candidate comes too near; empty for none."""
    corners = e.corners if isinstance(e, Check) else ()
    return why_near(too_near(s, s.candidate.goal, corners, w))


def _why_zoned(s: Situation, e: Event, w: World) -> str:
    """Return which zone bars the way to the candidate, by the corners of the event."""
    way = way_to(s, s.candidate.goal, e.corners if isinstance(e, Check) else (), w)
    outside = (why_outside(corner, w.cage) for corner in way.points[:-1])
    why = next(filter(None, outside), "") or why_barred(way, w.region)
    if why and way.reach and not way.begun:
        if way.origin.z < LOW:
            return f"{why}: from the floor a way bends; rise first"
        return f"{why}: in flight a way bends, from rest it may be free; hold first"
    searched = isinstance(e, Check) and e.searched
    return f"{why}; no way around it was found" if why and searched else why


def refuse_busy(s: Situation, _e: Event, _w: World) -> Situation:
    """Refuse a goal while another one is being flown."""
    x, y, z = astuple(s.end)
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
    ways = replace(after, reach=s.reach, corners=s.corners, leg=s.leg, legs=s.legs)
    return replace(ways, paused=Goto(s.goal, takeoff=s.takeoff))


def resume(s: Situation, _e: Event, w: World) -> Situation:
    """Fly on to the goal of the paused flight."""
    assert s.paused is not None  # noqa: S101 - RULES pairs this action with `paused`
    reason = f"went on after a pause: {s.reason.removeprefix(PAUSED)}"
    goal, takeoff = s.paused.goal, s.paused.takeoff
    s = replace(s, commanded=w.pose.stamp)
    return replace(
        s, goal=goal, brake=False, settling=False, takeoff=takeoff, paused=None, reason=reason
    )


def note(s: Situation, e: Event, _w: World) -> Situation:
    """Report that the flight paused; it has resumed already."""
    assert isinstance(e, Lagged)  # noqa: S101 - RULES pairs this action with Lagged alone
    return replace(s, reason=f"went on after a pause: {e.reason}")


def arrive(s: Situation, _e: Event, _w: World) -> Situation:
    """Hold the goal, ready for the next one."""
    return replace(s, takeoff=False, reason="", leg=0, legs=0)


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
            reason = f"stopped, the path led {where} by {stopping_excess(w):.2g} m"
        case _:
            done = "hovering in place" if s.state is State.HOVERING else "stopped"
            reason = f"{done}, {_why_excluded(s, w)}"
    after = _stopped(s, w, reason)
    # A guard reports once that a vehicle leaves; it can do nothing more.
    return replace(after, beyond=inf) if isinstance(e, Seen) else after


def stop_pose_jump(s: Situation, _e: Event, w: World) -> Situation:
    """Brake to the stopping point, because the vehicle cannot be at its pose."""
    way = dist(astuple(w.pose.position), astuple(w.last.position))
    seconds = w.pose.stamp - w.last.stamp
    reason = f"stopped, the pose jumped by {way:.3g} m in {seconds:.3g} s"
    return replace(_stopped(s, w, reason), beyond=inf)


def settle(s: Situation, _e: Event, w: World) -> Situation:
    """End a stop: the goal is the place where it ended."""
    return replace(s, goal=w.pose.position, settling=False)


def toggle(s: Situation, e: Event, w: World) -> Situation:
    """Turn the cage on or off."""
    assert isinstance(e, Toggle)  # noqa: S101 - RULES pairs this action with Toggle alone
    return caged(replace(_unpaused(s), cage_on=e.cage_on), w)


def toggle_and_stop(s: Situation, e: Event, w: World) -> Situation:
    """Turn the cage on, and stop, because the goal is now outside."""
    return stop(toggle(s, e, w), e, w)


def resize(s: Situation, _e: Event, w: World) -> Situation:
    """Fly or hover on within new bounds."""
    return caged(_unpaused(s), w)


def resize_and_stop(s: Situation, e: Event, w: World) -> Situation:
    """Stop, because the goal is outside the new bounds."""
    return stop(resize(s, e, w), e, w)


def reboot(s: Situation, e: Event, w: World) -> Situation:
    """Drop the goal, and stay where the new boot is."""
    assert isinstance(e, Booted)  # noqa: S101 - RULES pairs this action with Booted alone
    s = _stopped(caged(s, w), w, e.reason)
    return replace(s, boot=w.pose.boot, settling=False, commanded=-inf)


def _stopped(s: Situation, w: World, reason: str) -> Situation:
    here = w.pose.position
    s = replace(s, reach=motion(s), corners=(), leg=0, legs=0, commanded=w.pose.stamp)
    return replace(
        s, goal=here, brake=True, settling=True, takeoff=False, paused=None, reason=reason
    )


def _why_excluded(s: Situation, w: World) -> str:
    """Return why the present cage excludes the present way; empty if it does not."""
    for point in (s.goal, *s.corners):
        if why := why_outside(point, w.cage):
            return f"the goal is now {why}"
    return why_stopped(s, w)


def _unpaused(s: Situation) -> Situation:
    ended = "stopped, the cage was changed during a pause"
    return replace(_ended(s), reason=ended) if s.paused else s


def _ended(s: Situation) -> Situation:
    """Return the situation without a paused flight, which still brakes."""
    return replace(s, paused=None, reach=motion(s), corners=(), leg=0, legs=0) if s.paused else s


def always(_s: Situation, _e: Event, _w: World) -> bool:
    """Return True: the row applies if no row above it does."""
    return True


def blind(_s: Situation, _e: Event, w: World) -> bool:
    """Return whether there is no pose to rely on."""
    return not w.fresh


def may_replace(s: Situation, e: Event, _w: World) -> bool:
    """Return whether the present flight may be replaced: a take-off, or on request."""
    return s.takeoff or (isinstance(e, Goto) and e.replace)


def permitted(s: Situation, e: Event, w: World) -> bool:
    """Return whether the candidate is a place above the floor, and allowed if the cage is on.

    The box is convex: the straight way there stays inside, or comes nearer at every step. Zones are
    not: the way itself is checked, with its corners. It has to keep apart from vehicles in any case.
    """
    goal = s.candidate.goal
    points = (goal, *(e.corners if isinstance(e, Check) else ()))
    is_place = all(all(map(isfinite, astuple(p))) and not why_below(p) for p in points)
    if not is_place or (s.cage_on and (why_outside(goal, w.cage) or _why_zoned(s, e, w))):
        return False
    return not _why_near(s, e, w)


def from_flight(s: Situation, _e: Event, _w: World) -> bool:
    """Return whether the request came while another goal was being flown."""
    return s.back is State.MOVING


def arrived(s: Situation, _e: Event, w: World) -> bool:
    """Return whether the vehicle is within the acceptance range of its goal."""
    return dist(astuple(w.pose.position), astuple(s.goal)) < w.acceptance_range


def barred(s: Situation, e: Event, w: World) -> bool:
    """Return whether the present cage excludes the vehicle's present goal.

    A vehicle within the acceptance range still flies on to its goal, but not one that stops.
    """
    cage_on = e.cage_on if isinstance(e, Toggle) else s.cage_on
    return cage_on and not s.brake and bool(_why_excluded(s, w))


def cornering(s: Situation, _e: Event, _w: World) -> bool:
    """Return whether the vehicle flies a leg that is not the last."""
    return bool(s.corners)


def settled(s: Situation, _e: Event, w: World) -> bool:
    """Return whether a stop was commanded and the vehicle has come to rest."""
    return s.settling and at_rest(w.pose)


def paused(s: Situation, _e: Event, _w: World) -> bool:
    """Return whether a flight waits for poses."""
    return s.paused is not None


def jumped(_s: Situation, _e: Event, w: World) -> bool:
    """Return whether this pose is too far from the previous one for the vehicle's speed."""
    way = dist(astuple(w.pose.position), astuple(w.last.position))
    seconds = w.pose.stamp - w.last.stamp
    return way > w.envelope.speed * seconds + w.envelope.margin


def straying(s: Situation, _e: Event, w: World) -> bool:
    """Return whether, with the cage on, the vehicle can no longer stop inside or in `beyond`."""
    return s.cage_on and stopping_excess(w) > s.beyond + w.envelope.margin


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
            return after if after.state is rule.to else replace(after, state=rule.to)
    raise LookupError(f"no rule for {situation.state} and {event}")
