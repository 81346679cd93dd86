"""The barometer: raw samples, the last second of them, and the baseline taken from it."""

from collections import deque
from typing import NamedTuple

from schemas.messages import Pressure
from schemas.params import PressureParams
from services.pressure.atmosphere import pressure_at

AVERAGED = 1.0
"""Seconds of raw samples that a calibration averages."""


class Baseline(NamedTuple):
    """What is subtracted, hPa, and how many samples with which spread (hPa) it came from."""

    value: float = 0.0
    samples: int = 0
    spread: float = 0.0


class NoSample(Exception):
    """There is nothing to calibrate with yet."""


class Barometer:
    """A sensor at a height, with noise from the caller's random numbers."""

    def __init__(self, params: PressureParams) -> None:
        self._params = params
        self._recent: deque[tuple[float, float]] = deque()
        self.baseline = Baseline()

    def sample(self, now: float, stamp: float, height: float, uniform: float) -> Pressure:
        """Take a reading at a height (m).

        `now` is the clock by which the last second is judged, s; `stamp` the simulated time to
        report, s; `uniform` a random number in [-1, 1].
        """
        raw = pressure_at(height) + self._params.noise * uniform
        self._recent.append((now, raw))
        # Simulated time starts anew with a boot: what is dated later is of the old one.
        while not now - AVERAGED < self._recent[0][0] <= now:
            self._recent.popleft()
        value, samples, spread = self.baseline
        return Pressure(stamp, raw - value, value, samples, spread)

    def calibrate(self, *, zero: bool) -> float:
        """Take the mean of the last second as baseline, or drop it; returns the baseline, hPa.

        Raises NoSample, with the baseline unchanged, before the first reading.
        """
        if not zero:
            self.baseline = Baseline()
        elif not self._recent:
            raise NoSample
        else:
            raw = [value for _, value in self._recent]
            mean = sum(raw) / len(raw)
            self.baseline = Baseline(mean, len(raw), max(raw) - min(raw))
        return self.baseline.value
