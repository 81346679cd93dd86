"""When a rule fits: no effect, no memory."""

from math import dist, isfinite

from msgspec.structs import astuple

from services.safety.cage import why_below, why_outside
from services.safety.model import Ask, Event, Situation, State, Toggle, World
from services.safety.reach import at_rest, reach


def always(_s: Situation, _e: Event, _w: World) -> bool:
    """True."""
    return True


def blind(_s: Situation, _e: Event, w: World) -> bool:
    """No pose to rely on."""
    return not w.fresh


def may_replace(s: Situation, e: Event, _w: World) -> bool:
    """The flight under way gives way: it is the take-off, or the request says so."""
    return s.takeoff or (isinstance(e, Ask) and e.replace)


def permitted(s: Situation, _e: Event, w: World) -> bool:
    """The candidate may be flown to: a place above the floor, and the cage is off or holds it.

    The cage is convex, so the straight way there stays inside from inside, and comes nearer
    at every step from outside.
    """
    goal = s.candidate.goal
    is_place = all(map(isfinite, astuple(goal))) and not why_below(goal)
    return is_place and not (s.cage_on and why_outside(goal, w.cage))


def from_flight(s: Situation, _e: Event, _w: World) -> bool:
    """The request came while another goal was being flown."""
    return s.back is State.MOVING


def stranded(s: Situation, e: Event, w: World) -> bool:
    """The request came in flight, and the goal of that flight now lies outside."""
    return s.back is State.MOVING and barred(s, e, w)


def arrived(s: Situation, _e: Event, w: World) -> bool:
    """The vehicle is nearer to the goal than the acceptance range."""
    return dist(astuple(w.pose.position), astuple(s.goal)) < w.acceptance_range


def barred(s: Situation, e: Event, w: World) -> bool:
    """With the cage as it now is, the goal being flown to lies outside.

    A vehicle that has arrived within the range still flies on to its goal; one that stops does not.
    """
    cage_on = e.cage_on if isinstance(e, Toggle) else s.cage_on
    return cage_on and not s.brake and bool(why_outside(s.goal, w.cage))


def settled(s: Situation, _e: Event, w: World) -> bool:
    """A stop was commanded and the vehicle has come to rest."""
    return s.settling and at_rest(w.pose)


def paused(s: Situation, _e: Event, _w: World) -> bool:
    """A flight waits for poses."""
    return s.paused is not None


def jumped(_s: Situation, _e: Event, w: World) -> bool:
    """From the pose before to this one it would have been faster than the vehicle is."""
    way = dist(astuple(w.pose.position), astuple(w.last.position))
    seconds = w.pose.stamp - w.last.stamp
    return way > w.envelope.speed * seconds + w.envelope.margin


def straying(s: Situation, _e: Event, w: World) -> bool:
    """With the cage on, it can no longer stop inside, or where it may if it was put outside."""
    return s.cage_on and reach(w) > s.beyond + w.envelope.margin
