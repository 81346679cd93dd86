"""Limit on the number of vehicles without numba."""

from types import SimpleNamespace

import pytest

from quadctl.schemas.params import DynamicsParams, Params
from quadctl.services.runtime.errors import QuadctlError, UsageError
from quadctl.services.runtime.supervisor import capacity
from quadctl.services.runtime.supervisor.launch import Launch


def launch(count: int, rate: float = 20.0, speed: float = 1.0, without: tuple[str, ...] = ()):
    params = Params(dynamics=DynamicsParams(rate=rate, speed=speed))
    return Launch("lab", {f"uav{n}": params for n in range(count)}, [*without], "/")


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide numba, and set the duration of a step to 13 us."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr(capacity, "_step_seconds", lambda: 13e-6)


@pytest.mark.parametrize(
    ("step", "rates", "count"),
    [
        (13e-6, [20.0] * 100, 42),
        (6.5e-6, [20.0] * 100, 84),
        (13e-6, [1000.0] * 100, 10),
        (13e-6, [20.0, 1000.0], 16),
        (1e-2, [20.0] * 3, 0),
    ],
)
def test_vehicles_share_a_fixed_part_of_one_core(step: float, rates: list[float], count: int):
    assert capacity.most(step, rates) == count


@pytest.mark.usefixtures("plain")
def test_too_many_vehicles_are_refused_with_the_limit_and_the_extra():
    capacity.check(launch(42))
    with pytest.raises(UsageError) as caught:
        capacity.check(launch(100))
    assert caught.value.message == (
        "this machine flies about 42 vehicles at 20 Hz in plain Python, 100 were asked for"
    )
    assert "pip install 'quadctl[fleet]'" in caught.value.hint


@pytest.mark.usefixtures("plain")
def test_different_rates_are_both_named():
    mixed = launch(50).fleet | {"fast": Params(dynamics=DynamicsParams(rate=1000))}
    with pytest.raises(UsageError, match="at 20 to 1000 Hz"):
        capacity.check(Launch("lab", mixed, [], "/"))


@pytest.mark.usefixtures("plain")
@pytest.mark.parametrize(
    "asked", [launch(100, speed=0), launch(100, speed=2), launch(100, without=("dynamics",))]
)
def test_lock_step_and_runs_without_dynamics_have_no_limit(asked: Launch):
    capacity.check(asked)


@pytest.mark.parametrize(("count", "numba"), [(100, True), (1, False)])
def test_with_numba_or_one_vehicle_nothing_is_timed(
    monkeypatch: pytest.MonkeyPatch, count: int, numba: bool
):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: numba or None)
    monkeypatch.setattr(capacity, "_step_seconds", lambda: pytest.fail("timed"))
    capacity.check(launch(count))


def test_a_step_is_timed_in_its_own_process(monkeypatch: pytest.MonkeyPatch):
    assert 1e-7 < capacity._step_seconds() < 1.0
    done = SimpleNamespace(stdout="", stderr="no such module")
    monkeypatch.setattr("subprocess.run", lambda *args, **kwargs: done)
    with pytest.raises(QuadctlError, match="no such module"):
        capacity._step_seconds()
