"""Plan of a fleet's flights: an order, and points between, so that everybody arrives and none comes near.

One vehicle after the other is sent to its goal, straight or by another height, past the places where
the others are by then. Vehicles that stand on each other's goals make room first. Afterwards each leg
waits only for the earlier legs that it comes too near, so that most fly at the same time.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise, product
from math import ceil, dist

from msgspec import Struct

from quadctl.services.airspace.geometry import Piece, Point, distance
from quadctl.services.airspace.routes import HOP, LOW, legs
from quadctl.services.airspace.separation import WIDER
from quadctl.services.runtime.errors import Refused

Free = Callable[[str, Point, Point], bool]
"""Test of a vehicle's straight way: true if cage and zones permit it."""

_MARGIN = WIDER + 0.01
"""Metres by which a plan keeps farther away than vehicles must: a little more than safety asks for."""
_SPEED, _STOP = 2.0, 1.5
"""Speed (m/s) and seconds for speeding up and braking, to judge which way takes least."""
_ROOM = 3.0
"""Metres around all places and goals within which a vehicle makes room."""
_LOWEST = 0.5
"""Height (m) above the floor at which a vehicle passes others, or makes room."""
_HIGHEST = 12
"""Vehicles above each other that pass at most: without a cage, there is no highest."""
_MOST_SPOTS = 2000
_ATTEMPTS = 4
"""Plans that are tried, each with another vehicle first."""
_MOST_MOVES = 3
"""Times that a vehicle makes room."""


class Leg(Struct, frozen=True):
    """Straight flight of a vehicle to a point (m), after the legs with the numbers `after` began."""

    vehicle: str
    start: Point
    end: Point
    after: tuple[int, ...]


class Space(Struct, frozen=True):
    """Distances that vehicles keep (m), bounds of where they may be, and what is free for each."""

    across: float
    tall: float
    low: Point
    high: Point
    free: Free


def plan(places: Mapping[str, Point], goals: Mapping[str, Point], space: Space) -> list[Leg]:
    """Return the legs that bring vehicles to their goals past each other, in their order.

    `places` also has the vehicles that stay. Raises Refused, with who is in whose way.
    """
    _check_goals(places, goals, space)
    names, problem = list(goals), None
    for attempt in range(_ATTEMPTS):
        first = attempt * len(names) // _ATTEMPTS
        order = names[first:] + names[:first]
        try:
            return _Plan(places, {name: goals[name] for name in order}, space).legs()
        except Refused as refused:
            problem = problem or refused
    assert problem is not None  # noqa: S101 - there is an attempt
    raise problem


def _check_goals(places: Mapping[str, Point], goals: Mapping[str, Point], space: Space) -> None:
    ends = dict(places) | dict(goals)
    for name, goal in goals.items():
        for other, place in ends.items():
            if other != name and not _apart(goal, place, space):
                where = "goal" if other in goals else "place"
                raise Refused(
                    f"separation: the goal of {name} is too near the {where} of {other}",
                    "no vehicle was sent; "
                    f"two keep {space.across:g} m apart, or {space.tall:g} m above each other",
                )


def _apart(a: Point, b: Point, space: Space) -> bool:
    return _point_to_way(b, a, a, space) >= 1


def _rise_to_way(p: Point, a: Point, b: Point, space: Space) -> float:
    """Return `_point_to_way` of a vehicle that has yet to leave: from the floor it rises first."""
    if p[2] >= HOP:
        return _point_to_way(p, a, b, space)
    rise, keeps = Piece(p, (*p[:2], HOP)), (space.across + _MARGIN, space.tall + _MARGIN)
    return distance((rise,), (Piece(a, b),), *keeps) ** 2


def _point_to_way(p: Point, a: Point, b: Point, space: Space) -> float:
    """Return the square of a place's least distance from a straight way; 1 is just apart."""
    wide, tall = 1 / (space.across + _MARGIN), 1 / (space.tall + _MARGIN)
    ux, uy, uz = (b[0] - a[0]) * wide, (b[1] - a[1]) * wide, (b[2] - a[2]) * tall
    wx, wy, wz = (p[0] - a[0]) * wide, (p[1] - a[1]) * wide, (p[2] - a[2]) * tall
    length = ux * ux + uy * uy + uz * uz
    t = min(max((ux * wx + uy * wy + uz * wz) / length, 0.0), 1.0) if length else 0.0
    dx, dy, dz = wx - t * ux, wy - t * uy, wz - t * uz
    return dx * dx + dy * dy + dz * dz


def _parts(a: Point, b: Point) -> list[tuple[Point, Point]]:
    """Return the straight parts of a flight: from near the floor it climbs, see `_Plan._ways`."""
    return [(start, end) for start, end, _ in legs((a, b))]


class _Plan:
    """Plan in the making: where the vehicles are by then, and the legs so far."""

    def __init__(
        self, places: Mapping[str, Point], goals: Mapping[str, Point], space: Space
    ) -> None:
        self._at, self._goals, self._space = dict(places), goals, space
        self._legs: list[Leg] = []
        self._ends: list[float] = []
        """When each leg ends, at a guess, s."""
        self._last: dict[str, int] = {}
        """Number of each vehicle's last leg."""

    def legs(self) -> list[Leg]:
        left = list(self._goals)
        made_room: dict[str, int] = {}
        while left:
            stuck = [name for name in left if not self._send(name, self._goals[name])]
            if len(stuck) == len(left):
                moved = self._make_room(stuck, made_room)
                if not moved:
                    raise self._refused(stuck)
                # One that had arrived has to come back.
                stuck = list(dict.fromkeys([*stuck, moved]))
            left = stuck
        return self._legs

    def _send(self, name: str, end: Point) -> bool:
        """Append the quickest way of a vehicle to a point; return whether there is one."""
        timed = [self._timed(name, points) for points in self._ways(name, end)]
        if not timed:
            return False
        legs, ends = min(timed, key=lambda one: one[1][-1])
        self._legs += legs
        self._ends += ends
        self._last[name], self._at[name] = len(self._legs) - 1, end
        return True

    def _ways(self, name: str, end: Point) -> Iterator[tuple[Point, ...]]:
        """Yield the ways past the places of the others: straight, and by each height."""
        start = self._at[name]
        # A flight from the floor is straight only if it is a climb.
        if (start[2] >= LOW or start[:2] == end[:2]) and self._is_free(name, start, end):
            yield start, end
        for z in self._heights():
            points = (start, (*start[:2], z), (*end[:2], z), end)
            way = [a for a, b in pairwise(points) if a != b] + [end]
            if len(way) > 1 and all(self._is_free(name, a, b) for a, b in pairwise(way)):
                yield tuple(way)

    def _heights(self) -> list[float]:
        low, high = self._space.low[2] + _LOWEST, self._space.high[2]
        step = self._space.tall + 1.1 * _MARGIN
        known = (*self._at.values(), *self._goals.values())
        high = min(high, max(place[2] for place in known) + _HIGHEST * step)
        heights = [low + n * step for n in range(ceil((high - low) / step))]
        return [*heights, high]

    def _is_free(self, name: str, a: Point, b: Point) -> bool:
        return all(self._is_clear(name, start, end) for start, end in _parts(a, b))

    def _is_clear(self, name: str, a: Point, b: Point) -> bool:
        for other, place in self._at.items():
            leaves = place != self._goals.get(other, place)
            to_way = _rise_to_way if leaves else _point_to_way
            if other != name and to_way(place, a, b, self._space) < 1:
                # One that stands too near already may be left, but not approached.
                near = to_way(place, a, a, self._space)
                if near >= 1 or to_way(place, a, b, self._space) < near:
                    return False
        return self._space.free(name, a, b)

    def _timed(self, name: str, points: Sequence[Point]) -> tuple[list[Leg], list[float]]:
        """Return the legs between points, after those that they come too near, and their ends, s."""
        legs: list[Leg] = []
        ends: list[float] = []
        earlier = self._last.get(name)
        begins = 0.0 if earlier is None else self._ends[earlier]
        for a, b in pairwise(points):
            after = tuple(
                number
                for number, leg in enumerate(self._legs)
                if leg.vehicle != name and self._meet(leg, a, b)
            )
            begins = max([begins, *(self._ends[number] for number in after)])
            begins += dist(a, b) / _SPEED + _STOP
            legs.append(Leg(name, a, b, after))
            ends.append(begins)
        return legs, ends

    def _meet(self, leg: Leg, a: Point, b: Point) -> bool:
        across, tall = self._space.across + _MARGIN, self._space.tall + _MARGIN
        theirs, ours = (
            tuple(Piece(*part) for part in _parts(*ends)) for ends in ((leg.start, leg.end), (a, b))
        )
        return distance(theirs, ours, across, tall) < 1

    def _make_room(self, stuck: Sequence[str], done: dict[str, int]) -> str:
        """Send a vehicle out of the way, and return its name; empty if none can go.

        First those go that have gone least often, and those that have not arrived.
        """
        spots = self._spots()
        there = [
            name for name in self._goals if name not in stuck and self._is_near_any(name, stuck)
        ]
        for name in sorted([*stuck, *there], key=lambda name: done.get(name, 0)):
            if done.get(name, 0) == _MOST_MOVES:
                break
            start = self._at[name]
            for _, spot in sorted(spots, key=lambda spot: (spot[0], dist(spot[1], start))):
                if self._keeps_clear(name, spot, stuck) and self._send(name, spot):
                    done[name] = done.get(name, 0) + 1
                    return name
        return ""

    def _is_near_any(self, name: str, stuck: Sequence[str]) -> bool:
        """Return whether a vehicle is above, below or beside one that is stuck, or its goal."""
        x, y, _ = self._at[name]
        ends = (p for other in stuck for p in (self._at[other], self._goals[other]))
        return any((x - p[0]) ** 2 + (y - p[1]) ** 2 < (2 * self._space.across) ** 2 for p in ends)

    def _keeps_clear(self, name: str, spot: Point, stuck: Sequence[str]) -> bool:
        others = (place for other, place in self._at.items() if other != name)
        goals = (self._goals[other] for other in stuck)
        return all(_apart(spot, point, self._space) for point in (*others, *goals))

    def _spots(self) -> list[tuple[int, Point]]:
        """Return points to make room at, on a grid around all places and goals.

        With each, how many of these it is above or below: there it is in the way again.
        """
        known = [*self._at.values(), *self._goals.values()]
        axes = []
        for n, keep in enumerate((self._space.across, self._space.across, self._space.tall)):
            step = keep + 2 * _MARGIN
            least = self._space.low[n] + (_LOWEST if n == 2 else 0.0)
            low = max(min(p[n] for p in known) - _ROOM, least)
            high = min(max(p[n] for p in known) + _ROOM, self._space.high[n])
            axes.append([low + k * step for k in range(int((high - low) / step) + 1)])
        spots: list[Point] = list(product(*axes))  # type: ignore[arg-type]
        every = ceil(len(spots) / _MOST_SPOTS)
        wide = (self._space.across + _MARGIN) ** 2
        return [
            (sum((x - p[0]) ** 2 + (y - p[1]) ** 2 < wide for p in known), (x, y, z))
            for x, y, z in spots[::every]
        ]

    def _refused(self, stuck: Sequence[str]) -> Refused:
        name = stuck[0]
        goal = self._goals[name]
        near = [
            other for other, place in self._at.items()
            if other != name and _point_to_way(place, self._at[name], goal, self._space) < 1
        ]  # fmt: skip
        who = f"{', '.join(near)} is in the way of {name}" if near else f"{name} finds no way"
        others = f", and {len(stuck) - 1} more find none" if len(stuck) > 1 else ""
        return Refused(
            f"separation: {who}{others}",
            "no vehicle was sent; give more room, or send those in the way somewhere else first",
        )
