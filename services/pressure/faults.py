"""What goes wrong with a sensor, laid over its raw readings; pure."""

import math
from bisect import bisect_right
from collections import deque
from operator import itemgetter

from schemas.barometer import FaultParams
from services.pressure.draws import Draws

_LONGEST = 10.0
"""Seconds of readings that are kept; `pressure.fault.delay` asks for no more."""
_SLACK = 1e-6
"""What times that are multiples of a period may be off by rounding, s."""


class Faults:
    """Hands readings on as the fault in force leaves them; a changed one counts at once."""

    def __init__(self, params: FaultParams, draws: Draws) -> None:
        self._params, self._draws = params, draws
        self._past: deque[tuple[float, float]] = deque()
        self._given: float | None = None

    def through(self, stamp: float, raw: float) -> float | None:
        """What comes of a raw reading (hPa) taken at a time (s); None where nothing does."""
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
        """Remember the reading; returns the time of the one before it, its own if there is none."""
        # Simulated time starts anew with a boot: what is dated later is of the old one.
        if self._past and self._past[-1][0] > stamp:
            self._past.clear()
        before = self._past[-1][0] if self._past else stamp
        self._past.append((stamp, raw))
        # Of those older than is ever asked for the newest stays, as the value of that time.
        while len(self._past) > 1 and self._past[1][0] <= stamp - _LONGEST:
            self._past.popleft()
        return before

    def _spike(self, passed: float) -> float:
        """A glitch, hPa, or 0: they come at random, like drops of rain, at the mean interval."""
        chance = -math.expm1(-passed / self._params.interval)
        if self._draws.uniform(0, 1) >= chance:
            return 0.0
        return math.copysign(self._params.magnitude, self._draws.uniform(-1, 1))

    def _old(self, stamp: float) -> float | None:
        """The newest value of then or before, None where it was not yet switched on then."""
        count = bisect_right(self._past, stamp + _SLACK, key=itemgetter(0))
        return self._past[count - 1][1] if count else None
