"""Simulated sensor: the lab's known readings, and sensors as in their data sheets."""

import math
import random
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from quadctl.schemas.barometer import MOST_RATE, PressureParams, Profile
from quadctl.services.pressure.simulated import DRIFT, PARTS, Drift, Simulated, pressure_at

# Metres to pascals, computed separately with the standard's own constants: their exponent has more
# digits than the formula's 5.255876, which is 0.0003 Pa at 1000 m, 0.03 mm of height.
TABLE = [(1, 101312.9874), (10, 101204.9263), (100, 100129.4386), (1000, 89874.5705)]


@pytest.mark.parametrize(("height", "pascals"), TABLE)
def test_the_pressure_at_a_height_follows_the_standard(height: float, pascals: float):
    assert pressure_at(height) * 100 == pytest.approx(pascals, abs=4e-4)


def test_sea_level_is_the_standards_own_constant():
    assert pressure_at(0) == 1013.25


def test_the_pressure_falls_by_12_pascals_per_metre_near_the_ground():
    assert (pressure_at(0.5) - pressure_at(-0.5)) * 100 == pytest.approx(-12.013, abs=1e-3)


@given(st.floats(-100, 11_000), st.floats(0.001, 1000))
def test_the_pressure_always_falls_with_height(height: float, more: float):
    assert pressure_at(height + more) < pressure_at(height)


TIME = 1000.0


def walk(step: float, count: int, seed: int = 0) -> NDArray[np.float64]:
    """Return the drift at `count` times, `step` seconds apart."""
    drift, draws = Drift(TIME), random.Random(seed)
    drift.begin(0.0, draws)
    return np.array([drift.at(n * step, draws) for n in range(1, count + 1)])


def allan_variance(values: NDArray[np.float64], size: int) -> float:
    """Return half the mean square difference of neighbouring means of `size` values."""
    means = values[: len(values) // size * size].reshape(-1, size).mean(axis=1)
    return float(np.mean(np.diff(means) ** 2) / 2)


def test_the_spread_of_the_drift_is_constant_from_the_start():
    walks = np.array([walk(500.0, 8, seed) for seed in range(3000)])
    assert walks.std(axis=0) == pytest.approx(1, rel=0.05)
    assert walks.mean(axis=0) == pytest.approx(0, abs=0.07)


@pytest.mark.parametrize("step", [100.0, 1000.0, 2500.0])
def test_the_drift_decays_by_1_over_e_per_time_constant_at_any_rate(step: float):
    values = walk(step, 40_000)
    assert np.corrcoef(values[1:], values[:-1])[0, 1] == pytest.approx(
        math.exp(-step / TIME), abs=0.02
    )


@pytest.mark.parametrize("averaged", [100.0, 1000.0, 2000.0, 4000.0])
def test_the_allan_variance_is_that_of_a_gauss_markov_process(averaged: float):
    # Variance of a mean over r time constants, less its covariance with the next mean.
    r = averaged / TIME
    expected = (2 * (r - 1 + math.exp(-r)) - (1 - math.exp(-r)) ** 2) / r**2
    found = allan_variance(walk(20.0, 150_000), round(averaged / 20))
    assert found == pytest.approx(expected, rel=0.12)


NAMES = sorted(PARTS)
SEEDS = st.integers(0, 2**31 - 1)


def sensor(profile: Profile = "lab", seed: int = 0, noise: float = 1e-5) -> Simulated:
    def stream(name: str) -> random.Random:
        return random.Random(f"{seed} {name}")

    return Simulated(PressureParams(profile=profile, noise=noise), random.Random(seed), stream)


def pascals(of: Simulated, stamps: Iterable[float], boot: str = "a") -> list[float]:
    """Return the errors of the readings at height 0, Pa."""
    return [100 * of.read(boot, stamp, 0.0) - 101325 for stamp in stamps]


@given(SEEDS, st.floats(0, 10), st.lists(st.floats(-100, 10_000), min_size=1))
def test_lab_sensor_is_exactly_air_plus_one_uniform_number(
    seed: int, noise: float, heights: list[float]
):
    lab, numbers = sensor("lab", seed, noise), random.Random(seed)
    for stamp, height in enumerate(heights):
        expected = pressure_at(height) + noise * numbers.uniform(-1, 1)
        assert lab.read("a", stamp, height) == expected


def test_the_lab_sensor_with_seed_0_keeps_its_known_readings():
    lab = sensor()
    readings = [lab.read("a", n / 10, 1.0) for n in range(3)]
    assert readings == [1013.1298812776357, 1013.1298795482867, 1013.1298728006303]


def test_a_new_noise_applies_from_the_next_sample():
    params, numbers = PressureParams(noise=0.0), random.Random(0)
    lab = Simulated(params, random.Random(0), random.Random)
    assert lab.read("a", 0.0, 0.0) == 1013.25
    numbers.uniform(-1, 1)
    params.noise = 0.5
    assert lab.read("a", 0.1, 0.0) == 1013.25 + 0.5 * numbers.uniform(-1, 1)


def test_every_sensor_is_in_both_tables():
    assert set(PARTS) == set(MOST_RATE)


@pytest.mark.parametrize("name", NAMES)
def test_the_noise_matches_the_table(name: Profile):
    part = PARTS[name]
    # All at one time: the same bias in all, and no drift.
    found = pascals(sensor(name), [0.0] * 20_000)
    steps = part.resolution**2 / 12
    assert np.std(found) == pytest.approx((part.noise**2 + steps) ** 0.5, rel=0.02)
    centred = np.array(found) - np.mean(found)
    assert np.mean(centred**4) / np.mean(centred**2) ** 2 == pytest.approx(3, abs=0.2)  # Gaussian
    assert abs(np.corrcoef(centred[1:], centred[:-1])[0, 1]) < 0.03  # white


@given(st.sampled_from(NAMES), SEEDS, st.floats(0, 1e6), st.floats(0, 10_000))
def test_readings_are_multiples_of_the_resolution(
    name: Profile, seed: int, stamp: float, height: float
):
    steps = 100 * sensor(name, seed).read("a", stamp, height) / PARTS[name].resolution
    assert steps == pytest.approx(round(steps), abs=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_the_bias_is_constant_per_boot_and_within_the_accuracy(name: Profile):
    part = PARTS[name]

    def bias(seed: int, boots: int) -> list[float]:
        of = sensor(name, seed)
        return [float(np.mean(pascals(of, [0.0] * 50, f"boot {n}"))) for n in range(boots)]

    found = bias(1, 400)
    assert found[:2] == bias(1, 2)
    assert abs(found[0] - found[1]) > part.resolution
    assert abs(found[0] - bias(2, 1)[0]) > part.resolution
    # Uniform within the accuracy, plus the drift at the time of the boot.
    spread = (part.accuracy**2 / 3 + DRIFT**2) ** 0.5
    assert np.std(found) == pytest.approx(spread, rel=0.1)
    assert max(map(abs, found)) < part.accuracy + 5 * DRIFT


def test_the_bias_does_not_depend_on_the_previous_boot():
    brief, long = sensor("bmp388"), sensor("bmp388")
    pascals(brief, [0.0])
    pascals(long, [n / 10 for n in range(500)])
    first, other = (np.mean(pascals(of, [0.0] * 100, "b")) for of in (brief, long))
    assert first == pytest.approx(other, abs=0.05)


def test_the_drift_stays_bounded_over_hours():
    found = pascals(sensor("bmp388"), range(0, 2_000_000, 100))
    assert np.std(found) == pytest.approx(DRIFT, rel=0.1)


@given(st.sampled_from(NAMES), SEEDS, st.lists(st.floats(0, 100), min_size=2, max_size=20))
def test_the_same_seed_and_times_give_the_same_readings(
    name: Profile, seed: int, times: list[float]
):
    stamps = sorted(times)
    assert pascals(sensor(name, seed), stamps) == pascals(sensor(name, seed), stamps)


def test_another_profile_applies_from_the_next_reading():
    params = PressureParams()
    of = Simulated(params, random.Random(0), random.Random)
    assert pascals(of, [0.0])[0] == pytest.approx(0, abs=0.01)
    params.profile = "ms5611"
    assert abs(pascals(of, [0.1])[0]) > 1
    params.profile = "lab"
    assert pascals(of, [0.2])[0] == pytest.approx(0, abs=0.01)
