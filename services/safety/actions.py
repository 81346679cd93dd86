"""What a rule does: the next situation, all but its state."""

from math import dist, inf

from msgspec.structs import astuple, replace

from schemas.messages import PAUSED
from services.safety.cage import why_below, why_outside
from services.safety.model import (
    Ask,
    Booted,
    Event,
    Gone,
    Halted,
    Hold,
    Lagged,
    Lost,
    Seen,
    Situation,
    State,
    Toggle,
    World,
)
from services.safety.reach import REACTION, caged, leeway, reach


def keep(s: Situation, _e: Event, _w: World) -> Situation:
    """Nothing changes."""
    return s


def consider(s: Situation, e: Event, _w: World) -> Situation:
    """Take the request up for verification."""
    assert isinstance(e, Ask)  # noqa: S101 - RULES pairs this action with Ask alone
    # Until it is accepted, the flight under way is still the one it was.
    return replace(s, request=s.request + 1, candidate=e, back=s.state, paused=None, reason="")


def take(s: Situation, _e: Event, w: World) -> Situation:
    """Fly to the candidate, from outside no farther out than cannot be helped."""
    goal, takeoff = s.candidate.goal, s.candidate.takeoff
    s = s if s.beyond < inf else caged(s, w)
    return replace(s, goal=goal, brake=False, settling=False, takeoff=takeoff, reason="")


def follow(s: Situation, _e: Event, w: World) -> Situation:
    """Fly or hover on; what has been left behind of the way back is not to be gone out again."""
    if not s.cage_on or not 0 < s.beyond < inf or w.pose.stamp < s.since + REACTION:
        return s
    out = leeway(w)
    return replace(s, beyond=out) if out < s.beyond else s


def refuse(s: Situation, _e: Event, w: World) -> Situation:
    """Outside the cage or below the floor: what was, stays."""
    goal = s.candidate.goal
    below = "" if s.cage_on else why_below(goal)
    return replace(s, reason=below or why_outside(goal, w.cage))


def refuse_busy(s: Situation, _e: Event, _w: World) -> Situation:
    """Another goal is being flown."""
    x, y, z = astuple(s.goal)
    reason = f"busy: flying to ({x:g}, {y:g}, {z:g}); ask with replace to change course"
    return replace(s, request=s.request + 1, reason=reason)


def refuse_blind(s: Situation, _e: Event, _w: World) -> Situation:
    """No goal is taken without a pose."""
    reason = "no pose: dynamics is silent"
    if s.paused:
        reason = f"{PAUSED}{reason}; no goal is taken meanwhile"
    return replace(s, request=s.request + 1, reason=reason)


def pause(s: Situation, e: Event, w: World) -> Situation:
    """Brake to the stopping point, until poses come again."""
    assert isinstance(e, Lost)  # noqa: S101 - RULES pairs this action with Lost alone
    flight = Ask(s.goal, takeoff=s.takeoff)
    return replace(_stopped(s, w, f"{PAUSED}no pose for {e.limit:g} s"), paused=flight)


def resume(s: Situation, _e: Event, _w: World) -> Situation:
    """Fly on to the goal of the flight that paused."""
    assert s.paused is not None  # noqa: S101 - RULES pairs this action with `paused`
    reason = f"went on after a pause: {s.reason.removeprefix(PAUSED)}"
    goal, takeoff = s.paused.goal, s.paused.takeoff
    return replace(
        s, goal=goal, brake=False, settling=False, takeoff=takeoff, paused=None, reason=reason
    )


def note(s: Situation, e: Event, _w: World) -> Situation:
    """Say that the flight paused: it goes on already."""
    assert isinstance(e, Lagged)  # noqa: S101 - RULES pairs this action with Lagged alone
    return replace(s, reason=f"went on after a pause: {e.reason}")


def arrive(s: Situation, _e: Event, _w: World) -> Situation:
    """Hold the goal; ready for the next one."""
    return replace(s, takeoff=False, reason="")


def stop(s: Situation, e: Event, w: World) -> Situation:
    """Brake to the stopping point, and say why."""
    match e:
        case Lost(seconds):
            reason = f"no pose for {seconds:g} s: stopped"
        case Gone(why):
            reason = f"{why}: stopped"
        case Halted(why):
            reason = f"stopped, {why}"
        case Hold():
            reason = "hold: stopped on request"
        case Seen():
            reason = f"stopped, the way led out of the cage by {reach(w):.2g} m"
        case _:
            done = "hovering in place" if s.state is State.HOVERING else "stopped"
            reason = f"{done}, the goal is now {why_outside(s.goal, w.cage)}"
    after = _stopped(s, w, reason)
    # A guard tells once of a vehicle that leaves: it can do no more about it.
    return replace(after, beyond=inf) if isinstance(e, Seen) else after


def stop_astonished(s: Situation, _e: Event, w: World) -> Situation:
    """Brake to the stopping point: the vehicle is not where it can be."""
    way = dist(astuple(w.pose.position), astuple(w.last.position))
    seconds = w.pose.stamp - w.last.stamp
    reason = f"stopped, the pose jumped by {way:.3g} m in {seconds:.3g} s"
    return replace(_stopped(s, w, reason), beyond=inf)


def settle(s: Situation, _e: Event, w: World) -> Situation:
    """The stop is over: this is where it ended."""
    return replace(s, goal=w.pose.position, settling=False)


def toggle(s: Situation, e: Event, w: World) -> Situation:
    """Turn the cage on or off."""
    assert isinstance(e, Toggle)  # noqa: S101 - RULES pairs this action with Toggle alone
    return caged(replace(_unpaused(s), cage_on=e.cage_on), w)


def toggle_and_stop(s: Situation, e: Event, w: World) -> Situation:
    """Turn the cage on, and stop, because the goal now lies outside."""
    return stop(toggle(s, e, w), e, w)


def resize(s: Situation, _e: Event, w: World) -> Situation:
    """Fly or hover on in other bounds."""
    return caged(_unpaused(s), w)


def resize_and_stop(s: Situation, e: Event, w: World) -> Situation:
    """Stop, because the goal lies outside of the other bounds."""
    return stop(resize(s, e, w), e, w)


def reboot(s: Situation, e: Event, w: World) -> Situation:
    """Drop the goal: stay where the new boot stands."""
    assert isinstance(e, Booted)  # noqa: S101 - RULES pairs this action with Booted alone
    return replace(
        caged(s, w),
        boot=w.pose.boot,
        goal=w.pose.position,
        brake=True,
        settling=False,
        takeoff=False,
        paused=None,
        reason=e.reason,
    )


def _stopped(s: Situation, w: World, reason: str) -> Situation:
    return replace(
        s,
        goal=w.pose.position,
        brake=True,
        settling=True,
        takeoff=False,
        paused=None,
        reason=reason,
    )


def _unpaused(s: Situation) -> Situation:
    ended = "stopped, the cage was changed during a pause"
    return replace(s, paused=None, reason=ended) if s.paused else s
