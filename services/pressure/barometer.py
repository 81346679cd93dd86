"""Baseline and faults over raw readings. Pure."""

import math
from bisect import bisect_right
from collections import deque
from operator import itemgetter
from typing import NamedTuple

from quadctl.schemas.barometer import FaultParams, PressureParams
from quadctl.schemas.messages import Pressure
from quadctl.services.pressure.simulated import NoiseSource

_LONGEST = 10.0
"""Seconds of readings that are kept: the most that `pressure.fault.delay` can need."""
_SLACK = 1e-6
"""Rounding error (s) of times that are multiples of a period."""


class SensorFaults:
    """Readings as the fault in force changes them; a new fault counts at once."""

    def __init__(self, params: FaultParams, draws: NoiseSource) -> None:
        self._params, self._draws = params, draws
        self._past: deque[tuple[float, float]] = deque()
        self._given: float | None = None

    def through(self, stamp: float, raw: float) -> float | None:
        """Return the output for a raw reading (hPa) taken at a time (s), None if there is none."""
        before = self._keep(stamp, raw)
        given = self._faulty(before, stamp, raw)
        if given is not None:
            self._given = given
        return given

    def _faulty(self, before: float, stamp: float, raw: float) -> float | None:
        match self._params.kind:
            case "none":
                return raw
            case "off":
                return None
            case "stuck":
                return raw if self._given is None else self._given
            case "glitch":
                return raw + self._spike(stamp - before)
            case "delay":
                return self._old(stamp - self._params.delay)

    def _keep(self, stamp: float, raw: float) -> float:
        """Store the reading; return the time of the previous one, its own if there is none."""
        # Simulated time restarts with a boot: later times are of the old one.
        if self._past and self._past[-1][0] > stamp:
            self._past.clear()
        before = self._past[-1][0] if self._past else stamp
        self._past.append((stamp, raw))
        # Beyond the longest delay the newest reading stays, as the value of that time.
        while len(self._past) > 1 and self._past[1][0] <= stamp - _LONGEST:
            self._past.popleft()
        return before

    def _spike(self, passed: float) -> float:
        """Return a glitch, hPa, or 0: glitches come at random (Poisson), at the mean interval."""
        chance = -math.expm1(-passed / self._params.interval)
        if self._draws.uniform(0, 1) >= chance:
            return 0.0
        return math.copysign(self._params.magnitude, self._draws.uniform(-1, 1))

    def _old(self, stamp: float) -> float | None:
        """Return the newest value of that time or before, None from before it was switched on."""
        count = bisect_right(self._past, stamp + _SLACK, key=itemgetter(0))
        return self._past[count - 1][1] if count else None


AVERAGED = 1.0
"""Seconds of raw readings that a calibration averages."""


class Baseline(NamedTuple):
    """Value to subtract, hPa, with the number and the spread (hPa) of its samples."""

    value: float = 0.0
    samples: int = 0
    spread: float = 0.0


class NoSample(Exception):
    """Lack of readings for a calibration: none yet, or none of late."""


class Barometer:
    """Raw readings less the baseline."""

    def __init__(self, params: PressureParams) -> None:
        self._params = params
        self._recent: deque[tuple[float, float]] = deque()
        self.baseline = Baseline()

    def take(self, now: float, stamp: float, raw: float) -> Pressure:
        """Return the message for a raw reading (hPa) at a clock's and a simulated time (s)."""
        self._recent.append((now, raw))
        # Simulated time restarts with a boot: later times are of the old one.
        while not now - AVERAGED < self._recent[0][0] <= now:
            self._recent.popleft()
        value, samples, spread = self.baseline
        return Pressure(stamp, raw - value, value, samples, spread)

    def forget(self) -> None:
        """Drop the readings of the last second."""
        self._recent.clear()

    def calibrate(self, now: float, *, zero: bool) -> float:
        """Take the mean of the last second as baseline, or drop it; return the baseline, hPa.

        Raises NoSample, with the baseline unchanged, if the last second brought no reading; at
        rates under 2 Hz, if the last two periods did.
        """
        longest = max(AVERAGED, 2 / self._params.rate)
        if not zero:
            self.baseline = Baseline()
        elif not self._recent or not now - longest < self._recent[-1][0] <= now:
            raise NoSample
        else:
            raw = [value for _, value in self._recent]
            mean = sum(raw) / len(raw)
            self.baseline = Baseline(mean, len(raw), max(raw) - min(raw))
        return self.baseline.value
