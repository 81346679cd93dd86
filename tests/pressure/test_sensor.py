"""The barometer: what it shows, and how it is zeroed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.messages import Pressure
from schemas.params import PressureParams
from services.pressure.atmosphere import pressure_at
from services.pressure.sensor import Barometer, Baseline, NoSample

UNIFORM = st.floats(-1, 1)


def sampled(barometer: Barometer, *readings: tuple[float, float], height: float = 0.0) -> Pressure:
    """Take readings, each at a time with a random number; returns the last."""
    shown = None
    for now, uniform in readings:
        shown = barometer.sample(now, now + 100, height, uniform)
    assert shown is not None
    return shown


def test_unzeroed_it_shows_the_air_itself():
    shown = Barometer(PressureParams()).sample(7.0, 3.5, 10.0, 0.0)
    assert shown == Pressure(3.5, pressure_at(10.0), 0.0, 0, 0.0)


@given(UNIFORM, st.floats(0, 10), st.floats(0, 100))
def test_the_noise_stays_within_its_half_width(uniform: float, noise: float, height: float):
    shown = Barometer(PressureParams(noise=noise)).sample(0.0, 0.0, height, uniform)
    assert abs(shown.pressure - pressure_at(height)) <= noise + 1e-12


@pytest.mark.parametrize(("uniform", "error"), [(-1.0, -0.25), (0.5, 0.125), (1.0, 0.25)])
def test_the_noise_follows_the_random_number(uniform: float, error: float):
    shown = sampled(Barometer(PressureParams(noise=0.25)), (0.0, uniform))
    assert shown.pressure - 1013.25 == pytest.approx(error, abs=1e-12)


def test_a_new_noise_counts_from_the_next_sample():
    params = PressureParams(noise=0.0)
    barometer = Barometer(params)
    sampled(barometer, (0.0, 1.0))
    params.noise = 0.5
    assert sampled(barometer, (0.1, 1.0)).pressure == 1013.75


def test_calibrating_without_a_sample_changes_nothing():
    barometer = Barometer(PressureParams())
    with pytest.raises(NoSample):
        barometer.calibrate(zero=True)
    assert barometer.baseline == Baseline(0.0, 0, 0.0)
    assert barometer.calibrate(zero=False) == 0.0


def test_the_baseline_is_the_mean_of_the_last_second_with_count_and_spread():
    barometer = Barometer(PressureParams(noise=1.0))
    # Two that are a second old or older, then those that count.
    sampled(barometer, (0.0, 1.0), (0.5, 1.0), (0.75, -0.5), (1.0, 0.25), (1.5, 1.0))
    assert barometer.calibrate(zero=True) == 1013.25 + (-0.5 + 0.25 + 1.0) / 3
    assert barometer.baseline.samples == 3
    assert barometer.baseline.spread == 1.5


def test_one_sample_is_enough():
    barometer = Barometer(PressureParams(noise=1.0))
    sampled(barometer, (0.0, 0.5))
    assert barometer.calibrate(zero=True) == 1013.75
    assert barometer.baseline == Baseline(1013.75, 1, 0.0)


def test_zeroed_it_shows_the_difference_and_how_good_the_baseline_is():
    barometer = Barometer(PressureParams(noise=1.0))
    sampled(barometer, (0.0, 0.5), (0.1, -0.5))
    assert barometer.calibrate(zero=True) == 1013.25
    assert sampled(barometer, (0.2, 0.25)) == Pressure(100.2, 0.25, 1013.25, 2, 1.0)


def test_zeroing_again_starts_from_the_raw_pressure_not_from_the_difference():
    barometer = Barometer(PressureParams())
    sampled(barometer, (0.0, 0.0))
    first = barometer.calibrate(zero=True)
    sampled(barometer, (0.1, 0.0))
    assert barometer.calibrate(zero=True) == first == 1013.25
    assert barometer.baseline.samples == 2


def test_undone_it_shows_the_air_again():
    barometer = Barometer(PressureParams())
    sampled(barometer, (0.0, 0.0))
    barometer.calibrate(zero=True)
    assert barometer.calibrate(zero=False) == 0.0
    assert sampled(barometer, (0.1, 0.0)) == Pressure(100.1, 1013.25, 0.0, 0, 0.0)


@given(st.lists(UNIFORM, min_size=1, max_size=10))
def test_the_default_noise_leaves_the_labs_band_after_zeroing(numbers: list[float]):
    barometer = Barometer(PressureParams())
    sampled(barometer, *((count / 10, number) for count, number in enumerate(numbers)))
    barometer.calibrate(zero=True)
    assert barometer.baseline.samples == len(numbers)
    assert abs(sampled(barometer, (1.0, numbers[0])).pressure) <= 2.0001e-5


def test_a_clock_that_starts_anew_leaves_the_old_samples_behind():
    """In lock-step the clock is simulated time, and a reset takes it back to 0."""
    barometer = Barometer(PressureParams(noise=1.0))
    sampled(barometer, (99.8, 1.0), (99.9, 1.0), (100.0, 1.0))
    sampled(barometer, (0.0, 0.0), (0.1, 0.0))
    assert barometer.calibrate(zero=True) == 1013.25
    assert barometer.baseline.samples == 2
