"""The wandering of a real part's zero: steady in spread, and of one memory at any rate."""

import math
import random

import numpy as np
import pytest
from numpy.typing import NDArray

from quadctl.services.pressure.simulated import Drift

TIME = 1000.0


def walk(step: float, count: int, seed: int = 0) -> NDArray[np.float64]:
    """The values at so many times, `step` seconds apart."""
    drift, draws = Drift(TIME), random.Random(seed)
    drift.begin(0.0, draws)
    return np.array([drift.at(n * step, draws) for n in range(1, count + 1)])


def allan_variance(values: NDArray[np.float64], size: int) -> float:
    """Half the mean square difference of neighbouring means of `size` values."""
    means = values[: len(values) // size * size].reshape(-1, size).mean(axis=1)
    return float(np.mean(np.diff(means) ** 2) / 2)


def test_its_spread_is_the_same_from_the_first_moment_on():
    walks = np.array([walk(500.0, 8, seed) for seed in range(3000)])
    assert walks.std(axis=0) == pytest.approx(1, rel=0.05)
    assert walks.mean(axis=0) == pytest.approx(0, abs=0.07)


@pytest.mark.parametrize("step", [100.0, 1000.0, 2500.0])
def test_after_a_time_constant_the_eth_part_is_left_at_any_rate(step: float):
    values = walk(step, 40_000)
    assert np.corrcoef(values[1:], values[:-1])[0, 1] == pytest.approx(
        math.exp(-step / TIME), abs=0.02
    )


@pytest.mark.parametrize("averaged", [100.0, 1000.0, 2000.0, 4000.0])
def test_its_allan_variance_is_that_of_a_gauss_markov_process(averaged: float):
    # The variance of a mean over r time constants, less the covariance with the mean after it.
    r = averaged / TIME
    expected = (2 * (r - 1 + math.exp(-r)) - (1 - math.exp(-r)) ** 2) / r**2
    found = allan_variance(walk(20.0, 150_000), round(averaged / 20))
    assert found == pytest.approx(expected, rel=0.12)
