"""Traffic: the vehicles of a run that one process of safety looks after, kept apart.

Each vehicle reserves the space of its way, first come, first served. A vehicle in its own space is
apart from all others, so only one that has left it is compared with them.
"""

from collections.abc import Callable
from functools import partial
from math import sqrt
from threading import RLock
from typing import Protocol

from msgspec import Struct
from msgspec.structs import astuple

from quadctl.schemas.messages import Pose, Position
from quadctl.schemas.params import SeparationParams
from quadctl.services.safety.cage import soonest_stop
from quadctl.services.safety.model import Situation, State, World
from quadctl.services.safety.separation import (
    WIDER,
    How,
    Neighbour,
    Piece,
    Space,
    allowed,
    distance,
)
from quadctl.services.safety.way import off_course, reserved, rests

_REACTION = 0.3
"""Seconds from the command to stop until a sound vehicle brakes."""
_SHARE = 0.5
"""Share of the greatest deceleration that a sound vehicle brakes with."""
_ROUNDING = 1e-9


class Held(Struct, frozen=True):
    """Goal (m) that waits for the vehicles `behind` which it stands, and the space of its way.

    Of two that wait, the one with the lower number goes first.
    """

    goal: Position
    direct: bool
    space: Space
    behind: tuple[str, ...]
    number: int


class Member(Protocol):
    """What traffic has to know of a vehicle's monitor."""

    name: str
    pose: Pose
    situation: Situation
    held: Held | None

    @property
    def separation(self) -> SeparationParams:
        """Return its distance from others."""

    def world(self, others: tuple[Neighbour, ...] = ()) -> World:
        """Return the automaton's input, with its newest pose."""

    def recheck(self) -> None:
        """Stop the flight if another vehicle is on its way by now."""

    def part(self, reason: str) -> None:
        """Stop the flight, because another vehicle comes too near."""


Post = Callable[[Callable[[], None]], None]


class Traffic:
    """Vehicles that keep apart. Decisions about more than one of them need the lock."""

    def __init__(self) -> None:
        """Begin without a vehicle."""
        self.lock = RLock()
        self._members: dict[str, tuple[Member, Post]] = {}
        self._number = 0

    def join(self, member: Member, post: Post) -> None:
        """Add a vehicle; `post` runs a function on its loop."""
        self._members[member.name] = member, post

    def number(self) -> int:
        """Return the number of a request that has to wait."""
        self._number += 1
        return self._number

    def others(
        self, name: str, *, only: str = "", before: int | None = None
    ) -> tuple[Neighbour, ...]:
        """Return what the other vehicles reserve, or what the `only` one does.

        A goal that waits counts, too, if it came `before` a number, and does not wait for this one.
        """
        if len(self._members) < 2:
            return ()
        found: list[Neighbour] = []
        waiting: list[Neighbour] = []
        own = self._members[name][0].separation
        for other in self._others(name):
            across, tall = allowed(own, other.separation)
            if not across or (only and other.name != only):
                continue
            held, world = other.held, other.world()
            found += _neighbours(other, world, across, tall)
            earlier = held and (before is None or held.number < before)
            if held and earlier and not self.waits_for(other.name, name):
                waiting.append(
                    Neighbour(other.name, held.space, across, tall, How.WAITS, clears=True)
                )
        return (*found, *waiting)

    def will_clear(self, name: str, found: list[Neighbour]) -> bool:
        """Return whether every vehicle in the way will leave, and none waits for this one."""
        return all(one.clears and not self.waits_for(one.name, name) for one in found)

    def waits_for(self, waiter: str, name: str) -> bool:
        """Return whether a vehicle waits for another one, which may wait itself."""
        seen, left = set[str](), [waiter]
        while left:
            one = left.pop()
            member = self._members.get(one)
            if one in seen or member is None or member[0].held is None:
                continue
            seen.add(one)
            if name in member[0].held.behind:
                return True
            left += member[0].held.behind
        return False

    def moved(self, name: str) -> None:
        """Have the flights of the others checked again: a vehicle was put somewhere else."""
        for other in self._others(name):
            self._members[other.name][1](other.recheck)

    def watch(self, member: Member) -> None:
        """Stop a vehicle off its course, and another one, if they fly too near each other."""
        if len(self._members) < 2 or off_course(member.situation, member.pose) <= WIDER / 2:
            return
        world = member.world()
        for other in self._others(member.name):
            across, tall = allowed(member.separation, other.separation)
            keep = max(across, tall)
            if not across or _is_far(member.pose, other.pose, keep, world.envelope.deceleration):
                continue
            theirs = other.world()
            if not _meet(world, theirs, across, tall):
                continue
            for one, ours, another, its in (
                (member, world, other, theirs), (other, theirs, member, world)
            ):  # fmt: skip
                flies = one.situation.state is State.MOVING
                if flies and _approaches(ours, its, across, tall):
                    reason = f"stopped, separation: {another.name} came too near"
                    self._members[one.name][1](partial(one.part, reason))

    def _others(self, name: str) -> list[Member]:
        return [
            one
            for one, _ in tuple(self._members.values())
            if one.name != name and one.situation.boot
        ]


def _neighbours(other: Member, world: World, across: float, tall: float) -> list[Neighbour]:
    s, waits = other.situation, other.held is not None
    space = reserved(s, world)
    if rests(s, world):
        return [Neighbour(other.name, space, across, tall, How.IS, clears=waits)]
    end = astuple(s.paused.goal if s.paused and not s.corners else s.end)
    found = [Neighbour(other.name, space, across, tall, How.FLIES, clears=True)]
    if not s.settling:
        # There it will stay.
        stays = (Piece(end, end),)
        found.insert(0, Neighbour(other.name, stays, across, tall, How.ENDS, clears=waits))
    return found


def _is_far(a: Pose, b: Pose, keep: float, deceleration: float) -> bool:
    """Return whether two vehicles can stop before they are `keep` (m) apart, whatever their courses."""
    reach = keep
    for v in (a.velocity, b.velocity):
        speed = sqrt(v.x * v.x + v.y * v.y + v.z * v.z)
        reach += _REACTION * speed + speed * speed / deceleration
    dx, dy, dz = (
        a.position.x - b.position.x, a.position.y - b.position.y, a.position.z - b.position.z
    )  # fmt: skip
    return dx * dx + dy * dy + dz * dz > reach * reach


def _meet(a: World, b: World, across: float, tall: float) -> bool:
    """Return whether two vehicles that brake now come nearer than allowed, and than they are."""
    here, there = astuple(a.pose.position), astuple(b.pose.position)
    now = distance((Piece(here, here),), (Piece(there, there),), across, tall)
    soon = distance(_stop_path(a), _stop_path(b), across, tall)
    return soon < min(now, 1.0) - _ROUNDING


def _stop_path(w: World) -> Space:
    """Return the way of a vehicle until it has stopped."""
    p, v = w.pose.position, w.pose.velocity
    end = soonest_stop(w.pose, _SHARE * w.envelope.deceleration)
    reacted = (
        end.x + _REACTION * v.x, end.y + _REACTION * v.y, end.z + _REACTION * v.z
    )  # fmt: skip
    return (Piece(astuple(p), reacted),)


def _approaches(a: World, b: World, across: float, tall: float) -> bool:
    """Return whether a vehicle's own motion brings it nearer to another one."""
    p, q, v = a.pose.position, b.pose.position, a.pose.velocity
    wide, high = across * across, tall * tall
    return ((q.x - p.x) * v.x + (q.y - p.y) * v.y) / wide + (q.z - p.z) * v.z / high > 0
