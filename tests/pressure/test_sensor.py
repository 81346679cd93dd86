"""The barometer: what it shows of raw readings, and how it is zeroed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadctl.schemas.barometer import PressureParams
from quadctl.schemas.messages import Pressure
from quadctl.services.pressure.barometer import Barometer, Baseline, NoSample


def taken(barometer: Barometer, *readings: tuple[float, float]) -> Pressure:
    """Take readings, each at a time; returns what the last is shown as."""
    return [barometer.take(now, now + 100, raw) for now, raw in readings][-1]


@pytest.fixture
def barometer() -> Barometer:
    return Barometer(PressureParams())


def test_unzeroed_it_shows_the_air_itself(barometer: Barometer):
    assert barometer.take(7.0, 3.5, 1012.0) == Pressure(3.5, 1012.0, 0.0, 0, 0.0)


def test_calibrating_without_a_sample_changes_nothing(barometer: Barometer):
    with pytest.raises(NoSample):
        barometer.calibrate(0.0, zero=True)
    assert barometer.baseline == Baseline(0.0, 0, 0.0)
    assert barometer.calibrate(0.0, zero=False) == 0.0


def test_the_baseline_is_the_mean_of_the_last_second_with_count_and_spread(barometer: Barometer):
    # Two that are a second old or older, then those that count.
    taken(barometer, (0.0, 9.0), (0.5, 9.0), (0.75, 1.0), (1.0, 2.0), (1.5, 6.0))
    assert barometer.calibrate(1.55, zero=True) == 3.0
    assert barometer.baseline == Baseline(3.0, 3, 5.0)


def test_one_sample_is_enough(barometer: Barometer):
    taken(barometer, (0.0, 1013.75))
    assert barometer.calibrate(0.0, zero=True) == 1013.75
    assert barometer.baseline == Baseline(1013.75, 1, 0.0)


def test_zeroed_it_shows_the_difference_and_how_good_the_baseline_is(barometer: Barometer):
    taken(barometer, (0.0, 1013.75), (0.1, 1012.75))
    assert barometer.calibrate(0.1, zero=True) == 1013.25
    assert taken(barometer, (0.2, 1013.5)) == Pressure(100.2, 0.25, 1013.25, 2, 1.0)


def test_zeroing_again_starts_from_the_raw_pressure_not_from_the_difference(barometer: Barometer):
    taken(barometer, (0.0, 1013.25))
    first = barometer.calibrate(0.0, zero=True)
    taken(barometer, (0.1, 1013.25))
    assert barometer.calibrate(0.1, zero=True) == first == 1013.25
    assert barometer.baseline.samples == 2


def test_undone_it_shows_the_air_again(barometer: Barometer):
    taken(barometer, (0.0, 1013.25))
    barometer.calibrate(0.0, zero=True)
    assert barometer.calibrate(0.0, zero=False) == 0.0
    assert taken(barometer, (0.1, 1013.25)) == Pressure(100.1, 1013.25, 0.0, 0, 0.0)


def test_a_clock_that_starts_anew_leaves_the_old_samples_behind(barometer: Barometer):
    """In lock-step the clock is simulated time, and a reset takes it back to 0."""
    taken(barometer, (99.8, 9.0), (99.9, 9.0), (100.0, 9.0))
    with pytest.raises(NoSample):
        barometer.calibrate(0.05, zero=True)
    taken(barometer, (0.0, 1.0), (0.1, 1.0))
    assert barometer.calibrate(0.1, zero=True) == 1.0
    assert barometer.baseline.samples == 2


@given(st.floats(1, 100), st.floats(0.01, 200))
def test_readings_that_have_stopped_are_nothing_to_calibrate_with(silent: float, rate: float):
    barometer = Barometer(PressureParams(rate=rate))
    taken(barometer, (0.0, 1013.0))
    # Rarer ones than one a second may be two of their periods old.
    if silent < 2 / rate:
        assert barometer.calibrate(silent, zero=True) == 1013.0
    else:
        with pytest.raises(NoSample):
            barometer.calibrate(silent, zero=True)
        assert barometer.baseline == Baseline()
