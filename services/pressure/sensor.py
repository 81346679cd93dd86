"""The barometer: raw readings, the last second of them, and the baseline taken from it."""

from collections import deque
from typing import NamedTuple

from schemas.barometer import PressureParams
from schemas.messages import Pressure

AVERAGED = 1.0
"""Seconds of raw readings that a calibration averages."""


class Baseline(NamedTuple):
    """What is subtracted, hPa, and how many samples with which spread (hPa) it came from."""

    value: float = 0.0
    samples: int = 0
    spread: float = 0.0


class NoSample(Exception):
    """There is nothing to calibrate with: no reading yet, or none of late."""


class Barometer:
    """Shows raw readings less the baseline."""

    def __init__(self, params: PressureParams) -> None:
        self._params = params
        self._recent: deque[tuple[float, float]] = deque()
        self.baseline = Baseline()

    def take(self, now: float, stamp: float, raw: float) -> Pressure:
        """Show a raw reading, hPa.

        `now` is the clock by which the last second is judged, s; `stamp` the simulated time to
        report, s.
        """
        self._recent.append((now, raw))
        # Simulated time starts anew with a boot: what is dated later is of the old one.
        while not now - AVERAGED < self._recent[0][0] <= now:
            self._recent.popleft()
        value, samples, spread = self.baseline
        return Pressure(stamp, raw - value, value, samples, spread)

    def forget(self) -> None:
        """Drop the last second's readings."""
        self._recent.clear()

    def calibrate(self, now: float, *, zero: bool) -> float:
        """Take the mean of the last second as baseline, or drop it; returns the baseline, hPa.

        Raises NoSample, with the baseline unchanged, where the last second (of readings that are
        rarer than that, the last two periods) brought no reading.
        """
        if not zero:
            self.baseline = Baseline()
        elif not self._recent or not self._is_fresh(now):
            raise NoSample
        else:
            raw = [value for _, value in self._recent]
            mean = sum(raw) / len(raw)
            self.baseline = Baseline(mean, len(raw), max(raw) - min(raw))
        return self.baseline.value

    def _is_fresh(self, now: float) -> bool:
        longest = max(AVERAGED, 2 / self._params.rate)
        return now - longest < self._recent[-1][0] <= now
