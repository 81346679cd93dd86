"""Traffic: the vehicles of a run that one process of safety looks after, kept apart.

Each vehicle reserves the space of its way, first come, first served. A vehicle in its own space is
apart from all others, so only one that has left it is compared with them.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from math import dist, hypot
from typing import Protocol

from msgspec import Struct

from quadctl.schemas.messages import Pose
from quadctl.schemas.params import SeparationParams
from quadctl.services.airspace.geometry import (
    Box,
    Piece,
    Point,
    Space,
    around,
    distance,
    velocity_of,
)
from quadctl.services.airspace.routes import bend
from quadctl.services.airspace.separation import NOBODY, WIDER, How, Neighbour, Others, allowed
from quadctl.services.airspace.stopping import straight_stop
from quadctl.services.safety.model import Situation, World
from quadctl.services.safety.motion import (
    keeps_course,
    motion,
    off_course,
    reserved,
    space_after,
    stays,
)

_ROUNDING = 1e-9
_FARTHER = WIDER + 1e-6
"""Metres beyond the distance of two vehicles at which neither can matter to the other's way."""


_APART, _AHEAD = 0.015, 0.3
"""Seconds between two take-offs after a launch, so that of a thousand a quarter fly; and seconds of them that
may come at once."""
Mark = tuple[str, Point | int]
"""A vehicle, and its goal, or the number of its goal that waits: once that is another, it has flown."""


class Held(Struct, frozen=True):
    """Way to a goal that waits, by its points (m), first of all for the vehicle `first`.

    `behind` marks the vehicles that have to fly first. Of two goals that wait, the one with the lower
    number goes first.
    """

    points: tuple[Point, ...]
    direct: bool
    first: str
    behind: tuple[Mark, ...]
    number: int


class Participant(Protocol):
    """Monitor of a vehicle, as far as traffic needs it."""

    name: str
    pose: Pose
    situation: Situation
    held: Held | None

    @property
    def separation(self) -> SeparationParams:
        """Return its distance from others."""

    def world(self, others: Others = NOBODY) -> World:
        """Return the automaton's input, with its newest pose."""

    def recheck(self, only: str = "") -> None:
        """Stop the flight if another vehicle, or the `only` one, is on its way by now."""

    def give_way(self, reason: str) -> None:
        """Stop the flight, because another vehicle comes too near."""


Post = Callable[[Callable[[], None]], None]


class Traffic:
    """Vehicles that keep apart. Decisions about more than one of them need the lock."""

    def __init__(self, lock: AbstractContextManager[object] | None = None) -> None:
        """Begin without a vehicle; the lock is for monitors that several threads feed."""
        self.lock = lock or nullcontext()
        self._members: dict[str, _Member] = {}
        self._unattended: set[str] = set()
        self._next = 0.0
        """When the next vehicle may take off, monotonic s."""
        self._number = 0

    @property
    def is_shared(self) -> bool:
        """Return whether there are several vehicles."""
        return len(self._members) > 1

    def join(self, member: Participant, post: Post) -> None:
        """Add a vehicle; `post` runs a function on its loop."""
        self._members[member.name] = _Member(member, post)

    @property
    def begins(self) -> bool:
        """Return whether vehicles are still to be attended to."""
        return bool(self._unattended)

    def expect(self, name: str) -> None:
        """Let no vehicle take off before this one is attended to: meanwhile the first ones would lack setpoints."""
        self._unattended.add(name)

    def attend(self, name: str) -> None:
        """Record that a vehicle's poses are answered from now on."""
        self._unattended.discard(name)

    def may_take_off(self, now: float) -> bool:
        """Return whether all vehicles are attended to, and the next one may take off at a time (monotonic s)."""
        if self.begins or now < self._next:
            return False
        self._next = max(self._next, now - _AHEAD) + _APART
        return True

    def hold(
        self,
        name: str,
        points: tuple[Point, ...],
        near: Sequence[Neighbour],
        *,
        direct: bool,
        number: int,
    ) -> Held | None:
        """Return a vehicle's goal as one that waits; None if some of those in its way will not leave.

        What flies ends by itself, but no two may wait for each other. A goal that has waited before
        keeps its `number`; for another one it is 0.
        """
        if not all(self._will_clear(name, one) for one in near):
            return None
        if not number:
            self._number = number = self._number + 1
        behind = tuple(self._mark(one) for one in near if one.how is not How.FLIES)
        return Held(points, direct, near[0].name, behind, number)

    def _will_clear(self, name: str, one: Neighbour) -> bool:
        return one.how is How.FLIES or (one.clears and not self._waits_for(one.name, name))

    def _mark(self, one: Neighbour) -> Mark:
        other = self._members[one.name].participant
        if one.how is How.WAITS and other.held:
            return one.name, other.held.number
        return one.name, other.situation.goal

    def others(self, name: str, *, only: str = "", before: int | None = None) -> Others:
        """Return what the other vehicles reserve, or what the `only` one does; use it under the lock.

        A goal that waits counts, too, if it came `before` a number, and does not wait for this one.
        """
        return Others(partial(self._near, name, only, before)) if self.is_shared else NOBODY

    def _near(self, name: str, only: str, before: int | None, space: Space) -> list[Neighbour]:
        low, high = around(*(end for piece in space for end in piece[:2]))
        found: list[Neighbour] = []
        waiting: list[Neighbour] = []
        own = self._members[name].participant.separation
        for member in (self._members[only],) if only else tuple(self._members.values()):
            if member.is_clear(low, high, own):
                continue
            other = member.participant
            across, tall = allowed(own, other.separation)
            if not across or other.name == name or not other.situation.boot:
                continue
            held, world = other.held, other.world()
            found += _neighbours(other, world, across, tall)
            earlier = held and (before is None or held.number < before)
            if held and earlier and not self._waits_for(other.name, name):
                space = space_after(other.situation, held.points, world)
                waiting.append(Neighbour(other.name, space, across, tall, How.WAITS, clears=True))
        return [*found, *waiting]

    def _waits_for(self, waiter: str, name: str) -> bool:
        """Return whether a vehicle waits for another one, which may wait itself."""
        return name in self._chain(
            waiter, lambda held: [mark[0] for mark in held.behind if self._stands(mark)]
        )

    def leads(self, name: str) -> bool:
        """Return whether a vehicle that this one waits for, by itself or through others, is on its way."""
        ahead = self._chain(name, lambda held: [held.first, *(mark[0] for mark in held.behind)])
        return any(self._members[each].participant.situation.flies for each in ahead)

    def _chain(self, waiter: str, ahead_of: Callable[[Held], Iterable[str]]) -> Iterator[str]:
        """Yield the vehicles ahead of the goal of one that waits, and those that they wait for in turn."""
        seen, left = set[str](), [waiter]
        while left:
            one = left.pop()
            held = self._members[one].participant.held
            if one in seen or held is None:
                continue
            seen.add(one)
            for ahead in ahead_of(held):
                yield ahead
                left.append(ahead)

    def _stands(self, mark: Mark) -> bool:
        """Return whether a vehicle is still where it was, or waits for the same goal."""
        member = self._members[mark[0]].participant
        if isinstance(mark[1], int):
            return member.held is not None and member.held.number == mark[1]
        return member.situation.goal == mark[1]

    def moved(self, name: str) -> None:
        """Have the flights of the others checked again: a vehicle was put somewhere else."""
        for other in filter(lambda each: each.situation.flies, self._others(name)):
            self._members[other.name].post(partial(other.recheck, name))

    def watch(self, member: Participant, world: World) -> None:
        """Stop a vehicle off its course, and another one, if they fly too near each other."""
        if not self.is_shared or keeps_course(member.situation, world):
            return
        path = _stop_path(member.situation, world)
        for other in self._others(member.name):
            across, tall = allowed(member.separation, other.separation)
            theirs = other.world()
            if not across or _is_far(world, theirs, max(across, tall)):
                continue
            if not _meet(path, _stop_path(other.situation, theirs), across, tall):
                continue
            for one, ours, another, its in (
                (member, world, other, theirs), (other, theirs, member, world)
            ):  # fmt: skip
                if one.situation.flies and _approaches(ours, its, across, tall):
                    reason = f"stopped, separation: {another.name} came too near"
                    self._members[one.name].post(partial(one.give_way, reason))

    def _others(self, name: str) -> list[Participant]:
        everybody = [member.participant for member in tuple(self._members.values())]
        return [one for one in everybody if one.name != name and one.situation.boot]


class _Member:
    """Vehicle, the function that runs another one on its loop, and the box (m) of its ways."""

    __slots__ = ("_box", "_held", "_situation", "participant", "post")

    def __init__(self, participant: Participant, post: Post) -> None:
        self.participant, self.post = participant, post
        self._situation: Situation | None = None
        self._held: Held | None = None
        self._box: Box = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def is_clear(self, low: Point, high: Point, own: SeparationParams) -> bool:
        """Return whether the vehicle and all that it reserves are so far from a box that they do not matter.

        This runs for each of a thousand vehicles, and nearly all of them end at the first comparison.
        """
        of = self.participant
        if self._situation is not of.situation or self._held is not of.held:
            self._look()
        (x0, y0, z0), (x1, y1, z1) = self._box
        place, theirs = of.pose.position, of.separation
        x, across = place.x, own.radius + theirs.radius + _FARTHER
        west, east = low[0] - across, high[0] + across
        if (x0 > east and x > east) or (x1 < west and x < west):
            return True
        y, z, tall = place.y, place.z, 0.5 * (own.height + theirs.height) + _FARTHER
        return (
            min(y, y0) - high[1] > across
            or low[1] - max(y, y1) > across
            or min(z, z0) - high[2] > tall
            or low[2] - max(z, z1) > tall
        )

    def _look(self) -> None:
        """Compute the box of the present way and of one that waits; the vehicle may be outside it."""
        s, held = self.participant.situation, self.participant.held
        paused = (s.paused.goal,) if s.paused else ()
        points = (s.goal, *s.corners, *paused, *motion(s), *(held.points if held else ()))
        self._situation, self._held, self._box = s, held, bend(*points)


def _neighbours(other: Participant, world: World, across: float, tall: float) -> list[Neighbour]:
    s, waits = other.situation, other.held is not None
    space = reserved(s, world)
    if stays(s, world):
        return [Neighbour(other.name, space, across, tall, How.IS, clears=waits)]
    end = s.paused.goal if s.paused and not s.corners else s.end
    found = [Neighbour(other.name, space, across, tall, How.FLIES, clears=True)]
    if not s.stops:
        # There it will stay.
        there = (Piece(end, end),)
        found.insert(0, Neighbour(other.name, there, across, tall, How.ENDS, clears=waits))
    return found


def _is_far(a: World, b: World, keep: float) -> bool:
    """Return whether two vehicles can stop before they are `keep` (m) apart, whatever their courses."""
    reach = keep
    for world in (a, b):
        speed = hypot(*velocity_of(world.pose))
        reach += world.stop.reach(speed, speed)
    return dist(a.place, b.place) > reach


def _meet(a: Piece, b: Piece, across: float, tall: float) -> bool:
    """Return whether two vehicles that brake now come nearer than allowed, and than they are."""
    now = distance((Piece(a.start, a.start),), (Piece(b.start, b.start),), across, tall)
    return distance((a,), (b,), across, tall) < min(now, 1.0) - _ROUNDING


def _stop_path(s: Situation, w: World) -> Piece:
    """Return the way of a vehicle until it has stopped.

    One on its course, but for the margin, stops there, or as far off; of any other one nothing is known
    but its speed.
    """
    stop, off = w.stop, off_course(s, w)
    end = straight_stop(w.pose, stop.deceleration, stop.response)
    if s.stops or off <= w.margin:
        slack = 0.0 if s.stops else off
        x, y, z = (
            min(max(e, min(a, p) - slack), max(b, p) + slack)
            for e, p, a, b in zip(end, w.place, *motion(s), strict=True)
        )
        end = x, y, z
    return Piece(w.place, end)


def _approaches(a: World, b: World, across: float, tall: float) -> bool:
    """Return whether a vehicle's own motion brings it nearer to another one."""
    (x, y, z), (qx, qy, qz), (vx, vy, vz) = a.place, b.place, velocity_of(a.pose)
    wide, high = across * across, tall * tall
    return ((qx - x) * vx + (qy - y) * vy) / wide + (qz - z) * vz / high > 0
