"""Random missions: the events of a flight and their generation."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from math import ceil, inf, nan, nextafter, sqrt
from typing import Any, Protocol, TypeVar

import msgspec
from msgspec import Struct, structs

from quadctl.schemas.params import (
    CageParams,
    DynamicsParams,
    MeanWindParams,
    SafetyParams,
    StartParams,
    WindParams,
)
from quadctl.schemas.topics import SETPOINT
from quadctl.schemas.typed import converted
from quadctl.services.airspace.airworthiness import wind_margin
from quadctl.services.airspace.geometry import Point


class _Event(Struct, frozen=True, tag=True):
    """Event of a mission, at a simulated time, s."""

    at: float


class GotoEvent(_Event, frozen=True):
    """Request for a goal, m, which may be invalid."""

    x: float
    y: float
    z: float
    replace: bool


class HoldEvent(_Event, frozen=True):
    """Request to stop."""


class CageEvent(_Event, frozen=True):
    """Request to turn the cage on or off."""

    on: bool


class Resize(_Event, frozen=True):
    """Change of the cage's bounds, m."""

    x: float
    y: float
    z: float


class Range(_Event, frozen=True):
    """Change of the acceptance range, m."""

    metres: float


class Param(_Event, frozen=True):
    """Live change of a parameter, by its dotted name."""

    name: str
    value: float


class Deaf(_Event, frozen=True):
    """Time (s) in which no pose reaches safety."""

    seconds: float


class Mute(_Event, frozen=True):
    """Time (s) in which no setpoint reaches the vehicle."""

    seconds: float


class Stall(_Event, frozen=True):
    """Time (s) in which safety's process does not run."""

    seconds: float


class Stuck(_Event, frozen=True):
    """Time (s) in which the vehicle stops, whatever the setpoint is."""

    seconds: float


class Runaway(_Event, frozen=True):
    """Time (s) in which the vehicle flies to this place (m), whatever the setpoint is."""

    seconds: float
    x: float
    y: float
    z: float


class Reboot(_Event, frozen=True):
    """New boot of the simulation, and then a pose of the old one."""


class Jump(_Event, frozen=True):
    """The next pose is off by this much, m."""

    x: float
    y: float
    z: float


class Late(_Event, frozen=True):
    """Repetition of a pose of this age (s), after newer ones."""

    age: float


Fault = Deaf | Mute | Stall | Stuck | Runaway | Reboot | Jump | Late
Row = GotoEvent | HoldEvent | CageEvent | Resize | Range | Param | Fault


class Conditions(Struct, frozen=True):
    """Conditions of every flight of a campaign.

    Length (s), whether messages, processes and the vehicle fail, mean wind (m/s), the parameters,
    by dotted name, that are not random, and the number of vehicles.
    """

    seconds: float
    faults: bool = False
    wind: float = 0.0
    given: dict[str, Any] = {}
    vehicles: int = 1


class Mission(Struct, frozen=True):
    """One flight: seed, length (s), parameters at launch, events in order."""

    seed: int
    seconds: float
    safety: SafetyParams
    dynamics: DynamicsParams
    rows: tuple[Row, ...]

    @property
    def margin(self) -> float:
        """Return the margin beyond the cage that is in force in the wind at launch, m."""
        flies = self.dynamics
        return self.safety.margin + wind_margin(flies.vehicle, flies.control, flies.wind)


def text(row: Row) -> str:
    """Return an event as a line of a log."""
    values: dict[str, Any] = structs.asdict(row)
    del values["at"]
    fields = " ".join(
        f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
        for name, value in values.items()
    )
    return f"{type(row).__name__.removesuffix('Event').lower()} {fields}".rstrip()


def faults_of(rows: Sequence[Row]) -> dict[str, int]:
    """Return how many rows of each kind of fault there are."""
    return Counter(type(row).__name__ for row in rows if isinstance(row, Fault))


T = TypeVar("T")
Parameters = TypeVar("Parameters", SafetyParams, DynamicsParams)

GUST = 0.25
"""Ratio of the gusts' RMS on each axis to the mean wind."""
GRID = 2.0
"""Metres between neighbouring vehicles at the start."""
DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Directions of the wind, east and north: few, so that vehicles of a batch share weather."""
FAR = 10_000.0
"""Limit of a coordinate in a message, m."""


class RandomSource(Protocol):
    """Stream of random numbers, such as a seeded `random.Random`."""

    def random(self) -> float:
        """Return a uniformly distributed number in [0, 1)."""

    def uniform(self, a: float, b: float, /) -> float:
        """Return a uniformly distributed number in [a, b]."""


def missions(
    seed: int, conditions: Conditions, draws: Callable[[int | str], RandomSource]
) -> list[Mission]:
    """Return the missions of one flight: several vehicles share cage and wind, and start on a grid."""
    first = mission(seed, draws(seed), conditions)
    if conditions.vehicles == 1:
        return [first]
    cage, mean, given = first.safety.virtual_cage, first.dynamics.wind.mean, conditions.given
    columns = ceil(sqrt(conditions.vehicles))
    made = []
    for number in range(conditions.vehicles):
        column, row = number % columns, number // columns
        shared = {
            "safety.virtual_cage.x": cage.x, "safety.virtual_cage.y": cage.y, "safety.virtual_cage.z": cage.z,
            "dynamics.wind.mean.x": mean.x, "dynamics.wind.mean.y": mean.y,
            "dynamics.start.x": GRID * column, "dynamics.start.y": GRID * row, "dynamics.start.z": 0.0,
        }  # fmt: skip
        own = structs.replace(conditions, given=shared | given)
        made.append(mission(seed, draws(f"{seed}/{number}"), own))
    return made


def mission(seed: int, draws: RandomSource, conditions: Conditions) -> Mission:
    """Return a random mission; the given parameters replace random ones, which are drawn anyway."""
    wind, given = conditions.wind, conditions.given
    safety = SafetyParams(
        virtual_cage=CageParams(*_size(draws)),
        acceptance_range=_range(draws),
        cage_on=draws.random() < 0.85,
        takeoff=_one(draws, (1.0, 1.0, 0.0, draws.uniform(0.1, 4.0))),
    )
    safety = with_given(safety, "safety", given)
    cage = safety.virtual_cage
    size = cage.x, cage.y, cage.z
    x, y, z = (0.0, 0.0, 0.0) if draws.random() < 0.6 else _point(draws, size)
    start = (x, y, max(z, 0.0)) if abs(x) + abs(y) + abs(z) < FAR else (0.0, 0.0, 0.0)
    east, north = (wind * part for part in _one(draws, DIRECTIONS))
    dynamics = DynamicsParams(
        start=StartParams(*start),
        wind=WindParams(mean=MeanWindParams(east, north), gust=GUST * wind),
        # Neighbouring seeds still give unrelated gusts.
        seed=seed % 2**31,
    )
    dynamics = with_given(dynamics, "dynamics", given)
    rows = tuple(
        row
        for row in _rows(draws, conditions.seconds, size, faults=conditions.faults)
        if not (isinstance(row, Resize) and any(name.startswith(_CAGE) for name in given))
        and not (isinstance(row, Range) and _RANGE in given)
    )
    return Mission(seed, conditions.seconds, safety, dynamics, rows)


_CAGE, _RANGE = "safety.virtual_cage.", "safety.acceptance_range"


def with_given(section: Parameters, node: str, given: dict[str, Any]) -> Parameters:
    """Return a node's parameters with the given ones."""
    if not given:
        return section
    tables = msgspec.to_builtins(section)
    for name, value in given.items():
        first, *path, last = name.split(".")
        table = tables
        for part in path if first == node else ():
            table = table[part]
        if first == node:
            table[last] = value
    return converted(tables, type(section))


def _rows(draws: RandomSource, seconds: float, size: Point, *, faults: bool) -> Iterator[Row]:
    at, on = _gap(draws), True
    while at < seconds:
        kind = draws.random() * (1.15 if faults else 1.0)
        if kind < 0.62:
            yield GotoEvent(at, *_point(draws, size), replace=draws.random() < 0.5)
        elif kind < 0.78:
            on = draws.random() < 0.3 if on else draws.random() < 0.9
            yield CageEvent(at, on)
        elif kind < 0.86:
            size = _size(draws)
            yield Resize(at, *size)
        elif kind < 0.91:
            yield Range(at, _range(draws))
        elif kind < 1.0:
            yield HoldEvent(at)
        else:
            yield _fault(draws, at, size)
        at += _gap(draws)


def _fault(draws: RandomSource, at: float, size: Point) -> Row:
    kind = draws.random()
    if kind < 0.2:
        return Deaf(at, draws.uniform(0.05, 2.0))
    if kind < 0.4:
        return Mute(at, draws.uniform(0.05, 2.0))
    if kind < 0.5:
        return Stall(at, draws.uniform(0.05, 2.0))
    if kind < 0.55:
        return Stuck(at, draws.uniform(0.5, 3.0))
    if kind < 0.7:
        x, y, z = (draws.uniform(-3.0, 3.0) * bound for bound in size)
        return Runaway(at, draws.uniform(0.5, 3.0), x, y, abs(z))
    if kind < 0.75:
        return Reboot(at)
    if kind < 0.9:
        return Jump(at, *_jump(draws))
    return Late(at, draws.uniform(0.05, 1.0))


def _jump(draws: RandomSource) -> Point:
    """Return the error of a pose, often close to the longest way of a vehicle in one period."""
    x, y, z = (draws.uniform(-1.0, 1.0) for _ in range(3))
    period, safety = 1.0 / SETPOINT.hz, SafetyParams()
    longest = safety.max_speed * period
    length = _one(
        draws, (3.0, 2.0 * draws.random() * longest, longest + 2.0 * safety.margin * draws.random())
    )
    part = length / (sqrt(x * x + y * y + z * z) or 1.0)
    return part * x, part * y, part * z


def _gap(draws: RandomSource) -> float:
    """Return the time to the next event: often within the present flight, or 0."""
    return _one(draws, (0.0, draws.uniform(0.0, 0.5), draws.uniform(0.5, 3.0), draws.uniform(2, 8)))


def _range(draws: RandomSource) -> float:
    return _one(draws, (0.5, 0.5, draws.uniform(0.02, 0.5), draws.uniform(0.5, 5.0)))


def _size(draws: RandomSource) -> Point:
    small = draws.random() < 0.1
    most = 1.0 if small else 8.0
    return draws.uniform(0.2, most), draws.uniform(0.2, most), draws.uniform(0.2, 0.75 * most)


def _point(draws: RandomSource, size: Point) -> Point:
    """Return a goal: inside, on a wall, barely beyond it, outside, far away, or invalid."""
    cx, cy, cz = size
    place = [draws.uniform(-cx, cx), draws.uniform(-cy, cy), draws.uniform(0.0, cz)]
    walls = ((-cx, cx), (-cy, cy), (0.0, cz))
    kind, axis = draws.random(), int(3 * draws.random())
    wall = _one(draws, walls[axis])
    if kind < 0.25:
        # On a wall, on an edge, in a corner.
        place = [_one(draws, (value, *w)) for value, w in zip(place, walls, strict=True)]
        place[axis] = wall
    elif kind < 0.3:
        place[axis] = nextafter(wall, inf if wall > 0 else -inf)
    elif kind < 0.5:
        place[axis] = wall + draws.uniform(0.0, 6.0) * (1.0 if wall > 0 else -1.0)
    elif kind < 0.55:
        place = [3.0 * value for value in place]
    elif kind < 0.58:
        place[axis] = _one(draws, (nan, inf, -inf, FAR, -FAR))
    x, y, z = place
    return x, y, z


def _one(draws: RandomSource, choices: Sequence[T]) -> T:
    return choices[int(len(choices) * draws.random())]
