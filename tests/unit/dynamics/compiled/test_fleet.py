"""One source: plain Python and compiled code fly the same flight to the bit."""

import random
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from quadctl.schemas.params import DynamicsParams, MeanWindParams, StartParams, WindParams
from quadctl.schemas.vehicle import RotorDragParams
from quadctl.services.dynamics.compiled import source
from quadctl.services.dynamics.compiled.fleet import CompiledFleet
from quadctl.services.dynamics.compiled.kernel import WIDTH
from quadctl.services.dynamics.compiled.source import merged
from quadctl.services.dynamics.vehicle import Vehicle
from tests.support.compiled import compiled_kernel

Make = Callable[[Sequence[DynamicsParams]], CompiledFleet]


@pytest.fixture(scope="session")
def compiled() -> Make:
    module = compiled_kernel()
    return lambda params: CompiledFleet(params, module)


def vehicles(count: int, seed: int) -> list[DynamicsParams]:
    """Return parameters of vehicles on the floor and in the air, of three kinds."""
    draws = random.Random(seed)
    made = []
    for number in range(count):
        start = StartParams(
            draws.uniform(-2, 2), draws.uniform(-2, 2), draws.choice([0.0, 0.0, 2.5])
        )
        params = DynamicsParams(start=start)
        if number % 3 == 1:
            params.vehicle.mass = 1.2
            params.control.max_speed = 3.0
        if number % 3 == 2:
            params.vehicle.linear_drag = 0.05
            params.vehicle.rotor_drag = RotorDragParams(across=5e-5, along=2e-5)
            params.wind = WindParams(MeanWindParams(2.0, -1.0, 0.3), gust=1.0)
        params.seed = number
        made.append(params)
    return made


def fly_alike(make: Make, count: int, steps: int, seed: int) -> None:
    """Fly random goals, landings, brakes and rests in pieces of any size, compiled and plain."""
    draws, params = random.Random(seed), vehicles(count, seed)
    fleet, plain, flown = make(params), [Vehicle(each) for each in params], 0
    while flown < steps:
        for number, vehicle in enumerate(plain):
            kind = draws.random()
            if kind < 0.4:
                x, y = draws.uniform(-4, 4), draws.uniform(-4, 4)
                z = draws.choice([0.0, draws.uniform(0.2, 4)])
                fleet.goto(number, x, y, z)
                vehicle.goto(x, y, z)
            elif kind < 0.5:
                fleet.brake(number)
                vehicle.brake()
        piece = draws.choice([10, 33, 400, 1000])
        flown += piece
        fleet.fly(piece)
        for vehicle in plain:
            vehicle.advance(piece)
        assert fleet.states().tolist() == [list(vehicle.state) for vehicle in plain]


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
def test_compiled_code_flies_as_plain_python_to_the_bit(compiled: Make, seed: int):
    fly_alike(compiled, 6, 10_000, seed)


@pytest.mark.thorough
def test_more_vehicles_than_one_vector_fly_correctly(compiled: Make):
    count = 2 * WIDTH + 3
    params = [DynamicsParams(start=StartParams(0.01 * i, 0.0, 1.0)) for i in range(count)]
    fleet, plain = compiled(params), [Vehicle(each) for each in params]
    for number in (0, WIDTH - 1, WIDTH, 2 * WIDTH - 1, 2 * WIDTH, count - 1):
        fleet.goto(number, 0.01 * number, 1.0, 2.0)
        plain[number].goto(0.01 * number, 1.0, 2.0)
    fleet.fly(40)
    for vehicle in plain:
        vehicle.advance(40)
    assert fleet.states().tolist() == [list(vehicle.state) for vehicle in plain]


def test_the_merged_source_has_the_needed_functions():
    names = [
        function.name for function in merged(["flight_modes__control_period", "flight_modes__move"])
    ]
    assert {"rigidbody__step", "controller__control", "rotor__mix", "trajectory__switch"} <= set(
        names
    )
    with pytest.raises(KeyError):
        merged(["flight_modes__nonsense"])


def test_a_written_module_is_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert source.load_module("said", "WORD = 'one'").WORD == "one"
    assert source.load_module("said", "WORD = 'two'").WORD == "two"
    assert source.load_module("said", "WORD = 'one'").WORD == "one"
    assert len(list((tmp_path / "quadctl").glob("said_*.py"))) == 2
