"""Vehicles that fly at the same ticks: each flies as it would alone."""

import random
from collections.abc import Callable, Iterator

import pytest

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics.compiler import BackgroundCompiler, load
from quadctl.services.dynamics.formation import Formation
from quadctl.services.dynamics.vehicle import Vehicle
from tests.support.compiled import compiled_vehicle
from tests.unit.dynamics.compiled.test_fleet import vehicles


class Loop:
    """Executor of a node, which may be busy."""

    def __init__(self) -> None:
        self.is_busy = self.has_turn = False
        self.polled = 0
        self.posted: list[Callable[[], None]] = []
        self.rate: Callable[[], float] | None = None
        self.tick: Callable[[float], None] | None = None
        self.retimed = 0

    def every_together(
        self, hz: Callable[[], float], tick: Callable[[float], None]
    ) -> Callable[[], None]:
        self.rate, self.tick = hz, tick
        return self._retime

    def _retime(self) -> None:
        self.retimed += 1

    def take_turn(self) -> bool:
        self.has_turn = not self.is_busy
        return self.has_turn

    def end_turn(self) -> None:
        assert self.has_turn
        self.has_turn = False

    def post(self, item: Callable[[], None]) -> None:
        self.posted.append(item)

    def poll(self) -> None:
        self.polled += 1


class Flyer:
    """Vehicle that flies a period in one or two pieces at a tick, and notes it."""

    def __init__(self, params: DynamicsParams) -> None:
        self.vehicle, self.executor = Vehicle(params), Loop()
        self.rests = self.beats = False
        self.ticks: list[float] = []
        self.pieces: tuple[int, ...] = (50,)

    def flights(self, now: float) -> Iterator[int]:
        assert self.executor.has_turn or self.executor.is_busy
        for steps in self.pieces:
            before = self.vehicle.steps
            yield steps
            assert self.vehicle.steps == before + steps
        self.ticks.append(now)

    def fly(self, now: float) -> None:
        for steps in self.flights(now):
            self.vehicle.advance(steps)


def formation_of(flyers: list[Flyer], *, compiled: bool = True) -> tuple[Formation, Loop]:
    compiler, loop = BackgroundCompiler(), Loop()
    if compiled:
        compiler.model = load(compiled_vehicle())
    formation = Formation(loop.every_together, compiler)
    for each in flyers:
        formation.add(each)
    return formation, loop


def everything(vehicle: Vehicle) -> str:
    """Return all numbers of a vehicle as text: nan is not equal to itself."""
    return repr((vehicle.lane, vehicle.steps))


@pytest.mark.parametrize("compiled", [True, False])
def test_each_flies_as_it_would_alone(compiled: bool):
    draws = random.Random(7)
    params = [each for each in vehicles(4, 3) for _ in range(30)] if compiled else vehicles(3, 3)
    flyers, alone = [Flyer(each) for each in params], [Vehicle(each) for each in params]
    for number, (each, other) in enumerate(zip(flyers, alone, strict=True)):
        # Some begin in another phase of the control step, and some fly in two pieces.
        for vehicle in (each.vehicle, other):
            vehicle.advance(2 * (number % 2))
        each.pieces = (10, 40) if number % 3 == 0 else (50,)
    _, loop = formation_of(flyers, compiled=compiled)
    assert loop.tick is not None
    for count in range(25):
        for each, other in zip(flyers, alone, strict=True):
            if draws.random() < 0.1:
                goal = draws.uniform(-3, 3), draws.uniform(-3, 3), draws.choice([0.0, 1.0, 2.5])
                for vehicle in (each.vehicle, other):
                    vehicle.brake() if goal[2] == 2.5 else vehicle.goto(*goal)
        loop.tick(float(count))
        for other in alone:
            other.advance(50)
    assert [everything(each.vehicle) for each in flyers] == [everything(each) for each in alone]
    assert all(each.ticks == [*map(float, range(25))] for each in flyers)
    assert not any(each.executor.has_turn for each in flyers)


def test_one_that_rests_leaves_and_comes_again():
    flyers = [Flyer(DynamicsParams()) for _ in range(3)]
    formation, loop = formation_of(flyers)
    assert loop.tick
    assert loop.rate
    assert (loop.rate(), loop.retimed) == (20, 1)
    flyers[1].rests = True
    loop.tick(1.0)
    assert [each in formation for each in flyers] == [True, False, True]
    flyers[1].rests = False
    loop.tick(2.0)
    formation.add(flyers[1])
    loop.tick(3.0)
    assert [each.ticks for each in flyers] == [[1.0, 2.0, 3.0], [1.0, 3.0], [1.0, 2.0, 3.0]]
    for each in flyers:
        formation.remove(each)
    assert loop.rate() == 1


def test_the_vehicle_that_beats_has_flown_before_the_others_count():
    flyers = [Flyer(DynamicsParams()) for _ in range(3)]
    flyers[2].beats = True
    _, loop = formation_of(flyers)
    counted = list[int]()
    for each in flyers[:2]:
        each.executor.poll = lambda: counted.append(len(flyers[2].ticks))
    assert loop.tick
    loop.tick(1.0)
    assert counted == [1, 1]
    assert [each.ticks for each in flyers] == [[1.0]] * 3


def test_one_that_is_busy_flies_alone_once_it_is_not():
    flyers = [Flyer(DynamicsParams()) for _ in range(2)]
    _, loop = formation_of(flyers)
    assert loop.tick
    flyers[0].executor.is_busy = True
    loop.tick(1.0)
    assert [each.ticks for each in flyers] == [[], [1.0]]
    (item,) = flyers[0].executor.posted
    item()
    assert flyers[0].ticks == [1.0]
    assert flyers[0].executor.polled == 1


def test_an_error_ends_all_turns():
    flyers = [Flyer(DynamicsParams()) for _ in range(2)]
    _, loop = formation_of(flyers)
    assert loop.tick
    del flyers[1].ticks
    with pytest.raises(AttributeError):
        loop.tick(1.0)
    assert not any(each.executor.has_turn for each in flyers)
