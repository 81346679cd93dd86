"""Search for the worst flight by an evolution strategy, CMA-ES.

A run evolves the continuous numbers of a mission: start, times, kinds of row, goals. What is not
continuous (cage, wind, the parameter that changes in flight) stays the same during a run, also
because vehicles with equal constants fly faster together. A run begins with random missions, and the
worst of them is its first mean. It ends when it gets stuck, or is behind most others of its age; then
a new one begins elsewhere, in the surroundings of the worst flight, or at that flight itself.

The library is `cmaes`: MIT, pure Python on numpy, no other requirement. It is imported with the first
run: in 5 ms, or in 0.6 s where scipy is installed, which it then imports.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from math import cos, pi, sin
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import Struct, inspect, structs, to_builtins

from quadctl.schemas.params import (
    CageParams,
    DynamicsParams,
    MeanWindParams,
    SafetyParams,
    StartParams,
    WindParams,
)
from quadctl.schemas.topics import SETPOINT
from quadctl.schemas.typeinfo import fields
from quadctl.services.airspace.geometry import Point
from quadctl.services.campaign.mission import (
    GUST,
    CageEvent,
    Conditions,
    GotoEvent,
    HoldEvent,
    Mission,
    Param,
    Row,
    with_given,
)
from quadctl.services.campaign.score import Flown
from quadctl.services.campaign.watch import Floats
from quadctl.services.runtime.params.names import flatten

if TYPE_CHECKING:
    from cmaes import CMA

CAGES: tuple[Point, ...] = (
    (0.25, 0.25, 0.5), (0.5, 0.5, 1.0), (1.0, 1.0, 2.0), (2.5, 2.5, 5.0), (5.0, 5.0, 10.0),
    (0.2, 5.0, 3.0), (5.0, 5.0, 0.5), (0.5, 0.5, 10.0), (5.0, 2.0, 1.5),
)  # fmt: skip
"""Bounds of the cages, m: cubes, a slit, a slab, a shaft and a hall."""
LEGS = 8
"""Rows of a mission, except changed parameters."""
RUNS, POPULATION = 16, 32
"""Runs at a time, and missions in a generation of each."""
START, LEG = 4, 5
"""Numbers of a genome: for the start and for the change, then for each row."""
GENOME = START + LEGS * LEG
_LONGEST = 1.5
"""Time between two rows, s."""
_SIGMA = 0.2
"""Standard deviation of a run's first generation; all numbers are between 0 and 1."""
_PATIENCE, _GAIN = 25, 5e-5
"""Generations in which a run must find an excursion that is worse by so much, m."""
_AGES = (8, 16, 32, 64, 128)
"""Generations after which the worse half of the runs ends."""
_CHANGED = 0.3
"""Share of the surroundings in which a parameter changes."""
_FACTOR = 8.0
"""Largest ratio of a changed parameter to its value before, either way."""


class Surroundings(Struct, frozen=True):
    """Part of a mission that a run does not evolve: cage (m), wind (m/s), seed of its gusts.

    In flight one parameter may change; the time in the row does not count.
    """

    cage: Point
    wind: tuple[float, float]
    gusts: int
    change: Param | None


class Search:
    """Search in rounds; equal results for an equal seed, however the flights are shared out."""

    def __init__(self, seed: int, conditions: Conditions) -> None:
        self.evaluations = 0
        self._draws, self._conditions = np.random.default_rng(seed), conditions
        self._begun = 0
        self._ages: dict[int, list[float]] = defaultdict(list)
        self._asked: list[Mission] = []
        self._farthest: tuple[float, Surroundings, Floats] | None = None
        """Excursion beyond the allowed one (m) of the flight farthest out, and its mission."""
        self._worst: tuple[bool, float, Mission, Flown] | None = None
        """The same of the worst flight: any violation counts more than an excursion."""
        self._runs = [self._new() for _ in range(RUNS)]

    def ask(self) -> list[Mission]:
        """Return the missions of a round, numbered by their seeds; neighbours fly well together."""
        genomes = [(run.around, genome) for run in self._runs for genome in run.ask()]
        self._asked = [
            decode(genome, around, self._conditions, number)
            for number, (around, genome) in enumerate(genomes)
        ]
        return self._asked

    def tell(self, flights: Sequence[Flown]) -> bool:
        """Take the flights of a round, in any order; return whether one is the worst so far.

        A round with missions that have not flown is the last one.
        """
        self.evaluations += len(flights)
        before, beyond = self._worst, [0.0] * len(self._asked)
        for flight in sorted(flights, key=lambda each: each.seed):
            mission, (home, place) = self._asked[flight.seed], divmod(flight.seed, POPULATION)
            over = beyond[flight.seed] = flight.worst_excursion - mission.margin
            if self._farthest is None or over > self._farthest[0]:
                run = self._runs[home]
                self._farthest = over, run.around, run.genomes[place]
            rank = bool(flight.violations), over
            if self._worst is None or rank > self._worst[:2]:
                self._worst = *rank, mission, flight
        if len(flights) == len(self._asked):
            for number, run in enumerate(self._runs):
                run.tell(beyond[number * POPULATION : (number + 1) * POPULATION])
                if self._ends(run):
                    self._runs[number] = self._new()
        return self._worst is not before

    def document(self) -> dict[str, Any]:
        """Return the figures of the worst flight (m, s), and its mission as the tables of a file."""
        assert self._worst is not None  # noqa: S101 - called after the first flights
        _, _, mission, flight = self._worst
        return {
            "evaluations": self.evaluations,
            "worst_excursion": max(flight.worst_excursion, 0.0),
            "at": flight.at,
            "allowed": mission.margin,
            "violations": flight.violations,
            "mission": tables(mission),
        }

    def _ends(self, run: "_Run") -> bool:
        behind = False
        if run.age in _AGES:
            others = self._ages[run.age]
            behind = bool(others) and run.worst < median(others)
            others.append(run.worst)
        return behind or run.stuck

    def _new(self) -> "_Run":
        """Return a run elsewhere, where the worst flight was, or at that flight itself, in turn."""
        turn = self._begun % 3
        self._begun += 1
        seed = int(self._draws.integers(2**31))
        if turn == 0 or self._farthest is None:
            return _Run(self._elsewhere(), None, seed)
        _, around, genome = self._farthest
        return _Run(around, genome if turn == 1 else None, seed)

    def _elsewhere(self) -> Surroundings:
        draws, conditions = self._draws, self._conditions
        cage = CAGES[int(draws.integers(len(CAGES)))]
        change = _change(draws, conditions) if draws.random() < _CHANGED else None
        speed = conditions.wind * float(draws.choice((0.5, 1.0)))
        angle = 0.25 * pi * int(draws.integers(8))
        wind = speed * cos(angle), speed * sin(angle)
        return Surroundings(cage, wind, int(draws.integers(2**31)), change)


class _Run:
    """One run of CMA-ES; larger is worse, and sought."""

    def __init__(self, around: Surroundings, mean: Floats | None, seed: int) -> None:
        """Begin at a mean, or at the worst of a generation of random genomes."""
        self.around = around
        self.genomes: list[Floats] = []
        self.age, self.worst, self._improved = 0, -np.inf, 0
        self._seed = seed
        self._cma = None if mean is None else self._begun(mean, 0.5 * _SIGMA)

    def ask(self) -> list[Floats]:
        """Return the next generation."""
        if self._cma is None:
            draws = np.random.default_rng(self._seed)
            self.genomes = list(draws.random((POPULATION, GENOME)))
        else:
            self.genomes = [self._cma.ask() for _ in range(POPULATION)]
        return self.genomes

    def tell(self, beyond: Sequence[float]) -> None:
        """Take how far each flight of a generation went beyond the allowed excursion, m."""
        self.age += 1
        worst = max(beyond)
        if worst > self.worst + _GAIN:
            self.worst, self._improved = worst, self.age
        if self._cma is None:
            self._cma = self._begun(self.genomes[int(np.argmax(beyond))], _SIGMA)
        else:
            costs = [-each for each in beyond]
            self._cma.tell(list(zip(self.genomes, costs, strict=True)))

    @property
    def stuck(self) -> bool:
        """Return whether more generations would hardly find anything worse."""
        assert self._cma is not None  # noqa: S101 - called after `tell`
        return self.age - self._improved > _PATIENCE or bool(self._cma.should_stop())

    def _begun(self, mean: Floats, sigma: float) -> "CMA":
        from cmaes import CMA

        # Without bounds: decoding clips, and a goal on a wall may be anywhere beyond it.
        return CMA(mean.copy(), sigma, seed=self._seed, population_size=POPULATION)


_STRETCH = 1.5
"""Ratio of the range of a goal's number to the cage: a third of the goals lie on a wall of an axis."""
_AXES = ("x", "y", "z")


def decode(genome: Floats, around: Surroundings, conditions: Conditions, number: int) -> Mission:
    """Return the mission of a genome, with a number as its seed."""
    genes = np.clip(genome, 0.0, 1.0).tolist()
    speed = np.hypot(*around.wind)
    safety = with_given(
        SafetyParams(virtual_cage=CageParams(*around.cage)), "safety", conditions.given
    )
    cage = safety.virtual_cage
    size = [cage.x, cage.y, cage.z]
    sx, sy, sz, change = genes[:START]
    x, y, z = _place((sx, sy, sz), size)
    dynamics = DynamicsParams(
        start=StartParams(x, y, z),
        wind=WindParams(mean=MeanWindParams(*around.wind), gust=GUST * float(speed)),
        seed=around.gusts if speed else 0,
    )
    dynamics = with_given(dynamics, "dynamics", conditions.given)
    is_given = any(name.startswith("safety.virtual_cage.") for name in conditions.given)
    rows = list(_rows(genes[START:], size, resizes=not is_given))
    if around.change:
        at = round(change * rows[-1].at * SETPOINT.hz) / SETPOINT.hz
        rows = sorted([*rows, structs.replace(around.change, at=at)], key=lambda row: row.at)
    rows = [row for row in rows if row.at < conditions.seconds]
    return Mission(number, conditions.seconds, safety, dynamics, tuple(rows))


def _rows(genes: list[float], size: list[float], *, resizes: bool) -> Iterator[Row]:
    periods, on = 0, True
    for first in range(0, len(genes), LEG):
        gap, kind, x, y, z = genes[first : first + LEG]
        # Often shorter than the flight to a goal. Whole periods, so that it flies alike live.
        periods += 1 + round(gap * gap * (_LONGEST * SETPOINT.hz - 1))
        at = periods / SETPOINT.hz
        if kind < 0.75:
            yield GotoEvent(at, *_place((x, y, z), size), replace=kind < 0.7)
        elif kind < 0.9 or not resizes:
            on = not on if kind >= 0.82 else on
            yield CageEvent(at, on) if kind >= 0.82 else HoldEvent(at)
        else:
            axis = min(int(3 * x), 2)
            size[axis] = max(_SMALLEST, (0.2 + 1.3 * y) * size[axis])
            yield Param(at, f"safety.virtual_cage.{_AXES[axis]}", size[axis])


_SMALLEST = 0.2
"""Least bound of a cage, m."""


def _place(genes: Point, size: list[float]) -> Point:
    """Return a place in the cage, often on a wall or in a corner, m."""
    across, along, up = (min(max(_STRETCH * (g - 0.5) + 0.5, 0.0), 1.0) for g in genes)
    return (2 * across - 1) * size[0], (2 * along - 1) * size[1], up * size[2]


def _change(draws: np.random.Generator, conditions: Conditions) -> Param | None:
    """Return a parameter that is not given with a random value within its declared bounds."""
    params = with_given(DynamicsParams(), "dynamics", conditions.given)
    choices = [
        (f"dynamics.{table}.{field.encode_name}", before, kind.ge, kind.le)
        for table in ("control", "vehicle")
        for field in fields(type(getattr(params, table)))
        if isinstance(kind := getattr(field.type, "type", None), inspect.FloatType)
        if (before := getattr(getattr(params, table), field.encode_name)) > 0
    ]
    if conditions.faults:
        choices += [("dynamics.fault.motors", 1.0, 0.5, 1.0)] * len(choices)
    choices = [each for each in choices if each[0] not in conditions.given]
    if not choices:
        return None
    name, before, low, high = choices[int(draws.integers(len(choices)))]
    low, high = max(low, before / _FACTOR), min(high, before * _FACTOR)
    return Param(0.0, name, float(low * (high / low) ** draws.random()))


_DO: dict[type[Row], str] = {
    GotoEvent: "goto",
    HoldEvent: "hold",
    CageEvent: "cage",
    Param: "param",
}


def tables(mission: Mission) -> dict[str, Any]:
    """Return a mission of the search as the tables of a mission file."""
    usual = {"safety": SafetyParams(), "dynamics": DynamicsParams()}
    flown = {"safety": mission.safety, "dynamics": mission.dynamics}
    default = dict(flatten(to_builtins(usual)))
    return {
        "end": mission.seconds,
        "rows": [
            {"at": row.at, "do": _DO[type(row)]}
            | {name: value for name, value in structs.asdict(row).items() if name != "at"}
            for row in mission.rows
        ],
        "set": {
            name: value for name, value in flatten(to_builtins(flown)) if value != default[name]
        },
    }
