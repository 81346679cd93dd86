"""Plan of a fleet's flights: an order, and points between, so that everybody arrives and none comes near.

One vehicle after the other is sent to its goal, straight or by another height, past the places where
the others are by then. Vehicles that stand on each other's goals make room first. Afterwards each leg
waits only for the earlier legs that it comes too near, so that most fly at the same time.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise, product
from math import ceil, dist, floor

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
        if not space.free(name, goal, goal):
            hint = "no vehicle was sent; `quadctl cage show` and `quadctl zone list` print what is in force"
            raise Refused(f"the goal of {name} is outside its cage or in a zone", hint)
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


_Named = Sequence[tuple[str, Point]]
"""Points (m), each with the name of its vehicle."""


class _Cells:
    """Points (m) by squares of the floor, to find those near a place without a look at all of them."""

    def __init__(self, points: Iterable[tuple[str, Point]], size: float) -> None:
        """Take named points, and the side (m) of a square."""
        self._size = size
        self._cells: dict[tuple[int, int], list[tuple[str, Point]]] = {}
        for name, point in points:
            self._cells.setdefault(self._cell(point[0], point[1]), []).append((name, point))

    def _cell(self, x: float, y: float) -> tuple[int, int]:
        return floor(x / self._size), floor(y / self._size)

    def near(self, x: float, y: float) -> _Named:
        """Return all points within a square's side of a place, and some that are farther."""
        i, j = self._cell(x, y)
        around = product((i - 1, i, i + 1), (j - 1, j, j + 1))
        return [found for cell in around for found in self._cells.get(cell, ())]


_Floor = tuple[float, float, float, float]
"""Part of the floor (m): the least and the greatest x, the least and the greatest y."""


def _floor_of(a: Point, b: Point, keeps: float) -> _Floor:
    """Return the part of the floor within a distance (m) of a way, and some more."""
    (x0, y0, _), (x1, y1, _) = a, b
    low, high = (x0, x1) if x0 < x1 else (x1, x0)
    least, most = (y0, y1) if y0 < y1 else (y1, y0)
    return low - keeps, high + keeps, least - keeps, most + keeps


def _is_over(p: Point, ground: _Floor) -> bool:
    return ground[0] <= p[0] <= ground[1] and ground[2] <= p[1] <= ground[3]


def _leads_over(leg: Leg, ground: _Floor) -> bool:
    """Return whether a leg may lead over a part of the floor."""
    west, east, south, north = ground
    (x0, y0, _), (x1, y1, _) = leg.start, leg.end
    return (
        (x0 >= west or x1 >= west)
        and (x0 <= east or x1 <= east)
        and (y0 >= south or y1 >= south)
        and (y0 <= north or y1 <= north)
    )


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
        self._near = space.across + 2 * _MARGIN
        """Distance (m) to the side beyond which nothing matters to a way."""
        self._moves: list[Point] = []
        """Places from where and to where vehicles went, in order."""
        self._top = self._highest()
        """Greatest height (m) of all places and goals."""
        self._failed: dict[str, tuple[int, float]] = {}
        """By vehicle without a way to its goal: the number of moves and the greatest height by then."""

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
        is_goal = end == self._goals.get(name)
        if is_goal and not self._may_have_changed(name):
            return False
        timed = [self._timed(name, points) for points in self._ways(name, end)]
        if not timed:
            if is_goal:
                self._failed[name] = len(self._moves), self._top
            return False
        legs, ends = min(timed, key=lambda one: one[1][-1])
        self._legs += legs
        self._ends += ends
        self._moves += self._at[name], end
        self._last[name], self._at[name] = len(self._legs) - 1, end
        self._top = self._highest()
        return True

    def _may_have_changed(self, name: str) -> bool:
        """Return whether a vehicle without a way to its goal may have one since: others have gone there."""
        moves, top = self._failed.get(name, (-1, 0.0))
        if moves < 0 or top != self._top:
            return True
        ground = _floor_of(self._at[name], self._goals[name], self._near)
        return any(_is_over(place, ground) for place in self._moves[moves:])

    def _highest(self) -> float:
        return max(place[2] for place in (*self._at.values(), *self._goals.values()))

    def _ways(self, name: str, end: Point) -> Iterator[tuple[Point, ...]]:
        """Yield the ways past the places of the others: straight, and by each height."""
        start = self._at[name]
        ground = _floor_of(start, end, self._near)
        near = [one for one in self._at.items() if one[0] != name and _is_over(one[1], ground)]
        # A flight from the floor is straight only if it is a climb.
        if (start[2] >= LOW or start[:2] == end[:2]) and self._is_free(name, near, start, end):
            yield start, end
        for z in self._heights():
            points = (start, (*start[:2], z), (*end[:2], z), end)
            way = [a for a, b in pairwise(points) if a != b] + [end]
            if len(way) > 1 and all(self._is_free(name, near, a, b) for a, b in pairwise(way)):
                yield tuple(way)

    def _heights(self) -> list[float]:
        low, high = self._space.low[2] + _LOWEST, self._space.high[2]
        step = self._space.tall + 1.1 * _MARGIN
        high = min(high, self._top + _HIGHEST * step)
        heights = [low + n * step for n in range(ceil((high - low) / step))]
        return [*heights, high]

    def _is_free(self, name: str, near: _Named, a: Point, b: Point) -> bool:
        return all(self._is_clear(name, near, start, end) for start, end in _parts(a, b))

    def _is_clear(self, name: str, near: _Named, a: Point, b: Point) -> bool:
        ground, tall = _floor_of(a, b, self._near), self._space.tall + 2 * _MARGIN
        low, high = min(a[2], b[2]) - tall, max(a[2], b[2]) + tall
        for other, place in near:
            if place[2] > high or max(place[2], HOP) < low or not _is_over(place, ground):
                continue
            leaves = place != self._goals.get(other, place)
            to_way = _rise_to_way if leaves else _point_to_way
            if to_way(place, a, b, self._space) < 1:
                # One that stands too near already may be left, but not approached.
                now = to_way(place, a, a, self._space)
                if now >= 1 or to_way(place, a, b, self._space) < now:
                    return False
        return self._space.free(name, a, b)

    def _timed(self, name: str, points: Sequence[Point]) -> tuple[list[Leg], list[float]]:
        """Return the legs between points, after those that they come too near, and their ends, s."""
        legs: list[Leg] = []
        ends: list[float] = []
        earlier = self._last.get(name)
        begins = 0.0 if earlier is None else self._ends[earlier]
        for a, b in pairwise(points):
            ground = _floor_of(a, b, self._near)
            after = tuple(
                number
                for number, leg in enumerate(self._legs)
                if leg.vehicle != name and _leads_over(leg, ground) and self._meet(leg, a, b)
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
        spots, taken = self._spots(), set(stuck)
        places = _Cells(self._at.items(), self._near)
        ends = ((name, end) for name in stuck for end in (self._at[name], self._goals[name]))
        wanted = _Cells(ends, 2 * self._space.across)
        goals = _Cells(((name, self._goals[name]) for name in stuck), self._near)
        there = [
            name for name in self._goals if name not in taken and self._is_near_any(name, wanted)
        ]
        for name in sorted([*stuck, *there], key=lambda name: done.get(name, 0)):
            if done.get(name, 0) == _MOST_MOVES:
                break
            start = self._at[name]
            for _, spot in sorted(spots, key=lambda spot: (spot[0], dist(spot[1], start))):
                if self._keeps_clear(name, spot, places, goals) and self._send(name, spot):
                    done[name] = done.get(name, 0) + 1
                    return name
        return ""

    def _is_near_any(self, name: str, ends: _Cells) -> bool:
        """Return whether a vehicle is above, below or beside one that is stuck, or its goal."""
        x, y, _ = self._at[name]
        most = (2 * self._space.across) ** 2
        return any((x - p[0]) ** 2 + (y - p[1]) ** 2 < most for _, p in ends.near(x, y))

    def _keeps_clear(self, name: str, spot: Point, places: _Cells, goals: _Cells) -> bool:
        """Return whether a spot is apart from the places of others, and from the goals of those stuck."""
        others = [place for other, place in places.near(*spot[:2]) if other != name]
        ends = [goal for _, goal in goals.near(*spot[:2])]
        return all(_apart(spot, point, self._space) for point in (*others, *ends))

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
        cells = _Cells((*self._at.items(), *self._goals.items()), self._near)

        @cache
        def in_way(x: float, y: float) -> int:
            return sum((x - p[0]) ** 2 + (y - p[1]) ** 2 < wide for _, p in cells.near(x, y))

        return [(in_way(x, y), (x, y, z)) for x, y, z in spots[::every]]

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
