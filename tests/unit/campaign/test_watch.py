"""Conditions of sleeping monitors, against safety's own functions."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from quadctl.services.campaign import watch
from quadctl.services.campaign.score import Score
from tests.support.compiled import compiled_kernel

SIZE = (2.0, 3.0, 1.5)
BRAKING = 10.0


@cache
def loops_of(kind: str) -> Any:
    return watch if kind == "plain" else compiled_kernel()


metres = st.floats(-6.0, 6.0)
speeds = st.floats(-5.0, 5.0)
motions = st.tuples(metres, metres, metres, speeds, speeds, speeds)


def notes(**rows: float) -> watch.Floats:
    """Return notes on one monitor that waits for nothing, but for these rows."""
    made = np.zeros((len(watch.ROWS), 1))
    never = ("WANTED", "DUE", "BEYOND", "FASTEST")
    values = dict.fromkeys(never, np.inf) | {"BRAKING": BRAKING, "REACH": 0.5}
    values |= dict(zip(("SIZE", "SIZE_Y", "SIZE_Z"), SIZE, strict=True)) | rows
    for name, value in values.items():
        made[watch.ROWS.index(name)] = value
    return made


def look(loops: Any, rows: watch.Floats, now: Any, last: Any, period: int = 40) -> bool:
    found = np.empty(1, dtype=np.int64)
    columns = np.array([now]).T.copy(), np.array([last]).T.copy()
    return bool(loops.look(rows, *columns, period, found))


HERE = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
FAST = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0)


@pytest.mark.parametrize("kind", ["plain", "compiled"])
@pytest.mark.parametrize(
    ("rows", "now", "last", "expected"),
    [
        ({}, HERE, HERE, False),
        ({"WANTED": 40}, HERE, HERE, True),
        ({"WANTED": 41}, HERE, HERE, False),
        ({"MOVING": 1, "GOAL_Z": 1.0}, FAST, FAST, True),
        ({"MOVING": 0, "GOAL_Z": 1.0}, FAST, FAST, False),
        ({"MOVING": 1, "GOAL": 3.0, "MOVED": 30, "SEEN": 30}, HERE, HERE, False),
        ({"MOVING": 1, "GOAL": 3.0, "MOVED": 20, "SEEN": 10}, HERE, HERE, True),
        ({"MOVING": 1, "GOAL": 3.0, "MOVED": 20, "SEEN": 10}, FAST, FAST, False),
        ({"MOVING": 1, "GOAL": 3.0, "MOVED": 10, "SEEN": 35, "DUE": 40}, HERE, HERE, True),
        ({"MOVING": 1, "GOAL": 3.0, "MOVED": 10, "SEEN": 35, "DUE": 41}, HERE, HERE, False),
        ({"SETTLING": 1}, HERE, HERE, True),
        ({"SETTLING": 1}, FAST, FAST, False),
        ({"BEYOND": 0.0, "MARGIN": 0.01}, (2.1, *HERE[1:]), HERE, True),
        ({"BEYOND": 0.2, "MARGIN": 0.01}, (2.1, *HERE[1:]), HERE, False),
        ({"BEYOND": 0.0, "MARGIN": 0.01}, (1.99, 0.0, 1.0, 1.0, 0.0, 0.0), HERE, True),
        ({"FASTEST": 0.5}, (0.5, *HERE[1:]), HERE, True),
        ({"FASTEST": 0.51}, (0.5, *HERE[1:]), HERE, False),
    ],
)
def test_a_monitor_is_called_when_a_condition_may_hold(
    kind: str, rows: dict[str, float], now: Any, last: Any, expected: bool
):
    assert look(loops_of(kind), notes(**rows), now, last) is expected


@given(st.lists(motions, min_size=4, max_size=4))
def test_excursions_are_the_same_compiled(places: list[Any]):
    found = []
    for kind in ("plain", "compiled"):
        score = Score(2)
        score.confine(0, SIZE, 0.1)
        moved = np.array(places).reshape(2, 2, 6).transpose(0, 2, 1).copy()
        score.sample(moved, [1.0, 2.0], loops_of(kind))
        found.append((score.worst.tolist(), score.at.tolist()))
    assert found[0] == found[1]
    assert found[0][0][1] == 0.0


@pytest.mark.parametrize("kind", ["plain", "compiled"])
@given(vehicles=st.integers(2, 4), seed=st.integers(0, 999))
def test_the_separation_is_the_least_distance_in_each_flight(kind: str, vehicles: int, seed: int):
    flights, samples = 3, 5
    motions = np.random.default_rng(seed).normal(size=(samples, 6, flights * vehicles))
    score = Score(flights * vehicles, vehicles)
    times = [0.1 * number for number in range(samples)]
    score.sample(motions, times, loops_of(kind))
    for flight in range(flights):
        own = motions[:, :3, flight * vehicles : (flight + 1) * vehicles]
        apart = np.sqrt(((own[:, :, :, None] - own[:, :, None, :]) ** 2).sum(axis=1))
        apart[:, range(vehicles), range(vehicles)] = np.inf
        assert score.separation[flight] == pytest.approx(apart.min())
        when = times[int(apart.min(axis=(1, 2)).argmin())]
        assert score.separation_at[flight] == when
