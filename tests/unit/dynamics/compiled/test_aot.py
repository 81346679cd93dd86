"""A vehicle in machine code: equal to plain Python to the bit, also when switched in flight."""

import random
from pathlib import Path

import pytest

from quadctl.schemas.params import DynamicsParams
from quadctl.services.dynamics import flight_modes
from quadctl.services.dynamics.compiler import Code, load, store, stored
from quadctl.services.dynamics.vehicle import Vehicle
from tests.support.compiled import compiled_vehicle
from tests.unit.dynamics.compiled.test_fleet import vehicles


@pytest.fixture(scope="module")
def code() -> Code:
    return compiled_vehicle()


def everything(vehicle: Vehicle) -> str:
    """Return all numbers of a vehicle as text: nan is not equal to itself."""
    return repr((vehicle._state, vehicle._command, vehicle._plan, vehicle._mode, vehicle._air))


def command(draws: random.Random, params: DynamicsParams, *several: Vehicle) -> None:
    """Give each vehicle the same random goal, brake or parameters."""
    kind = draws.random()
    x, y, z = draws.uniform(-4, 4), draws.uniform(-4, 4), draws.choice([0.0, draws.uniform(0.2, 4)])
    limit = draws.uniform(1.0, 5.0)
    for vehicle in several:
        if kind < 0.6:
            vehicle.goto(x, y, z)
        elif kind < 0.8:
            vehicle.brake()
        else:
            params.control.max_speed = limit
            vehicle.configure(params)


@pytest.mark.parametrize("number", range(3))
def test_compiled_flight_equals_plain_python_and_may_alternate(code: Code, number: int):
    draws, params, model = random.Random(number), vehicles(3, 5)[number], load(code)
    plain, other = Vehicle(params), Vehicle(params)
    for _ in range(40):
        command(draws, params, plain, other)
        other.fly = model if draws.random() < 0.7 else flight_modes.fly
        for _ in range(draws.choice([1, 40, 200])):
            piece = draws.choice([1, 3, 10])
            plain.advance(piece)
            other.advance(piece)
        assert everything(other) == everything(plain)


def test_each_vehicle_has_its_own_state(code: Code):
    model = load(code)
    params = vehicles(2, 1)
    both, alone = [Vehicle(each) for each in params], Vehicle(params[0])
    for vehicle in (*both, alone):
        vehicle.fly = model
    for _ in range(100):
        for vehicle in (*both, alone):
            vehicle.goto(1.0, 1.0, 1.0)
            vehicle.advance(10)
    assert everything(both[0]) == everything(alone) != everything(both[1])


@pytest.mark.parametrize("count", [1, 9, 10, 64, 65])
def test_many_fly_in_blocks_as_each_alone(code: Code, count: int):
    draws, model = random.Random(count), load(code)
    for params in vehicles(3, count):
        several = [Vehicle(params) for _ in range(count)]
        for vehicle in several:
            vehicle.fly = model
            vehicle.goto(draws.uniform(-4, 4), draws.uniform(-4, 4), draws.choice([0.0, 1.0, 3.0]))
        for _ in range(20):
            start, steps = several[0].steps, draws.choice([1, 3, 10, 50])
            lanes = [each.lane for each in several]
            flown = model.fly(lanes, several[0].constants, start, steps)
            for vehicle in several:
                vehicle.advance(steps)
            assert repr(flown) == repr([each.lane for each in several])


@pytest.mark.thorough
def test_code_damaged_or_for_another_processor_is_not_loaded(
    code: Code, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert stored() is None
    store(code)
    assert stored() == code
    (file,) = (tmp_path / "quadctl").glob("vehicle_*.bin")
    whole = file.read_bytes()
    middle = len(whole) // 2
    for bad in (b"", whole[:-9], whole[:middle] + b"\0\0\0\0" + whole[middle + 4 :]):
        file.write_bytes(bad)
        assert stored() is None
    store(Code.sealed("another", code.function, code.machine))
    assert stored() is None
