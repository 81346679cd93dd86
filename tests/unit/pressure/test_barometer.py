"""Barometer: faults of raw readings, and calibration to zero."""

import random

import numpy as np
import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.barometer import FaultParams, PressureParams
from quadctl.schemas.messages import Pressure
from quadctl.services.pressure.barometer import Barometer, Baseline, NoSample, SensorFaults

READINGS = st.lists(st.floats(900, 1100), min_size=1, max_size=50)


def faults(seed: int = 0, **params: object) -> tuple[SensorFaults, FaultParams]:
    made = FaultParams(**params)  # type: ignore[arg-type]  # its fields, by name
    return SensorFaults(made, random.Random(seed)), made


def outputs(layer: SensorFaults, raw: list[float], begin: float = 0.0) -> list[float | None]:
    """Return the outputs for readings at 10 Hz."""
    return [layer.through(begin + n / 10, value) for n, value in enumerate(raw)]


@given(READINGS)
def test_without_a_fault_readings_are_unchanged(raw: list[float]):
    assert outputs(faults()[0], raw) == raw


@given(READINGS, READINGS, READINGS)
def test_a_stuck_sensor_repeats_the_last_value_until_cleared(
    before: list[float], stuck: list[float], after: list[float]
):
    layer, params = faults()
    outputs(layer, before)
    params.kind = "stuck"
    assert outputs(layer, stuck, 10.0) == [before[-1]] * len(stuck)
    params.kind = "none"
    assert outputs(layer, after, 20.0) == after


def test_a_sensor_stuck_from_the_start_keeps_its_first_value():
    assert outputs(faults(kind="stuck")[0], [1.0, 2.0, 3.0]) == [1.0, 1.0, 1.0]


def test_a_sensor_that_is_off_gives_no_value_until_cleared():
    layer, params = faults(kind="off")
    assert outputs(layer, [1.0, 2.0]) == [None, None]
    params.kind = "none"
    assert outputs(layer, [3.0], 0.2) == [3.0]


def test_a_sensor_stuck_after_off_keeps_its_last_value():
    layer, params = faults()
    outputs(layer, [1.0])
    params.kind = "off"
    outputs(layer, [2.0], 0.1)
    params.kind = "stuck"
    assert outputs(layer, [3.0], 0.2) == [1.0]


def test_glitches_have_the_requested_size_and_mean_interval():
    layer, _ = faults(kind="glitch", magnitude=3.0, interval=2.0)
    found = outputs(layer, [1000.0] * 50_000)
    assert set(found) == {997.0, 1000.0, 1003.0}
    at = [n for n, value in enumerate(found) if value != 1000.0]
    gaps = np.diff(at) / 10
    assert gaps.mean() == pytest.approx(2.0, rel=0.1)
    assert gaps.std() == pytest.approx(2.0, rel=0.15)  # at random, not in step
    assert found.count(997.0) / len(at) == pytest.approx(0.5, abs=0.05)


@given(st.integers(0, 1000))
def test_the_same_seed_gives_the_same_glitches(seed: int):
    raw = [1000.0] * 100
    one, other, another = (
        outputs(faults(number, kind="glitch")[0], raw) for number in (seed, seed, seed + 1)
    )
    assert one == other
    assert one != another


@given(st.integers(0, 100), READINGS)
def test_a_delay_gives_old_values_and_none_before_the_first(late: int, raw: list[float]):
    layer, _ = faults(kind="delay", delay=late / 10)
    assert outputs(layer, raw) == [None] * min(late, len(raw)) + raw[: max(len(raw) - late, 0)]


def test_a_delay_set_later_gives_old_values_and_can_change():
    layer, params = faults()
    outputs(layer, [float(n) for n in range(300)])
    params.kind, params.delay = "delay", 10.0
    assert layer.through(30.0, 300.0) == 200.0
    params.delay = 0.35
    # Between two readings the earlier one is in force.
    assert layer.through(30.1, 301.0) == 297.0


def test_a_new_boot_forgets_old_values():
    layer, _ = faults(kind="delay", delay=0.1)
    assert outputs(layer, [1.0, 2.0], 50.0) == [None, 1.0]
    assert outputs(layer, [3.0, 4.0], 0.0) == [None, 3.0]


def test_only_the_needed_past_is_kept():
    layer, _ = faults()
    outputs(layer, [0.0] * 10_000)
    assert len(layer._past) <= 102


def taken(barometer: Barometer, *readings: tuple[float, float]) -> Pressure:
    """Take timed readings, and return the message of the last one."""
    return [barometer.take(now, now + 100, raw) for now, raw in readings][-1]


@pytest.fixture
def barometer() -> Barometer:
    return Barometer(PressureParams())


def test_without_a_baseline_the_pressure_is_absolute(barometer: Barometer):
    assert barometer.take(7.0, 3.5, 1012.0) == Pressure(3.5, 1012.0, 0.0, 0, 0.0)


def test_calibrating_without_a_sample_changes_nothing(barometer: Barometer):
    with pytest.raises(NoSample):
        barometer.calibrate(0.0, zero=True)
    assert barometer.baseline == Baseline(0.0, 0, 0.0)
    assert barometer.calibrate(0.0, zero=False) == 0.0


def test_the_baseline_is_the_mean_of_the_last_second(barometer: Barometer):
    # Two are a second old or older, the others count.
    taken(barometer, (0.0, 9.0), (0.5, 9.0), (0.75, 1.0), (1.0, 2.0), (1.5, 6.0))
    assert barometer.calibrate(1.55, zero=True) == 3.0
    assert barometer.baseline == Baseline(3.0, 3, 5.0)


def test_one_sample_is_enough(barometer: Barometer):
    taken(barometer, (0.0, 1013.75))
    assert barometer.calibrate(0.0, zero=True) == 1013.75
    assert barometer.baseline == Baseline(1013.75, 1, 0.0)


def test_a_zeroed_reading_has_the_difference_and_baseline_quality(barometer: Barometer):
    taken(barometer, (0.0, 1013.75), (0.1, 1012.75))
    assert barometer.calibrate(0.1, zero=True) == 1013.25
    assert taken(barometer, (0.2, 1013.5)) == Pressure(100.2, 0.25, 1013.25, 2, 1.0)


def test_zeroing_again_starts_from_the_raw_pressure(barometer: Barometer):
    taken(barometer, (0.0, 1013.25))
    first = barometer.calibrate(0.0, zero=True)
    taken(barometer, (0.1, 1013.25))
    assert barometer.calibrate(0.1, zero=True) == first == 1013.25
    assert barometer.baseline.samples == 2


def test_unsetting_the_baseline_restores_the_absolute_pressure(barometer: Barometer):
    taken(barometer, (0.0, 1013.25))
    barometer.calibrate(0.0, zero=True)
    assert barometer.calibrate(0.0, zero=False) == 0.0
    assert taken(barometer, (0.1, 1013.25)) == Pressure(100.1, 1013.25, 0.0, 0, 0.0)


def test_a_clock_reset_drops_the_old_samples(barometer: Barometer):
    """In lock-step the clock is simulated time, and a reset takes it back to 0."""
    taken(barometer, (99.8, 9.0), (99.9, 9.0), (100.0, 9.0))
    with pytest.raises(NoSample):
        barometer.calibrate(0.05, zero=True)
    taken(barometer, (0.0, 1.0), (0.1, 1.0))
    assert barometer.calibrate(0.1, zero=True) == 1.0
    assert barometer.baseline.samples == 2


@given(st.floats(1, 100), st.floats(0.01, 200))
def test_calibration_refuses_old_readings(silent: float, rate: float):
    barometer = Barometer(PressureParams(rate=rate))
    taken(barometer, (0.0, 1013.0))
    # Below 1 Hz a reading may be two periods old.
    if silent < 2 / rate:
        assert barometer.calibrate(silent, zero=True) == 1013.0
    else:
        with pytest.raises(NoSample):
            barometer.calibrate(silent, zero=True)
        assert barometer.baseline == Baseline()
