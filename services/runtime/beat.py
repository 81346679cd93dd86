"""Times of a loop's ticks."""

import time
from collections.abc import Callable
from math import inf

from quadctl.schemas.topics import period

_LATE = 0.1
"""Lateness (s) beyond which a loop drops the ticks that it missed, and goes on in phase."""


class Beat:
    """Times of ticks, counted and not added up, so that none is lost to rounding.

    A callable rate (Hz) is read at every tick and after `retime`; a new rate counts from the last tick.
    With an `origin` (monotonic s), ticks of equal rates are at the same times, to the microsecond.
    """

    def __init__(self, hz: float | Callable[[], float], origin: float | None) -> None:
        self._rate_now, self._origin = hz if callable(hz) else lambda: hz, origin
        self._rate = self._rate_now()
        self._last = self._begin(time.monotonic(), 0)

    def _begin(self, now: float, count: int) -> float:
        """Count anew from a time (monotonic s), or from the last common tick before; return that."""
        if self._origin is not None and self._rate < inf:
            now = self._origin + period(now - self._origin, self._rate) / self._rate
        self._count_from(now, count)
        return now

    def _count_from(self, start: float, count: int) -> None:
        self._start, self._count = start, count
        self.due = round(start + count / self._rate, 6)
        """Time of the next tick, monotonic s."""

    def is_due(self, now: float) -> bool:
        """Return whether the next tick is due, at its rate as it is now."""
        if (rate := self._rate_now()) != self._rate:
            self._rate = rate
            self._begin(self._last, 1)
            self._drop_missed(now)
            return False
        if now < self.due:
            return False
        # Not `now`: with each new rate, loops would drift apart that tick together.
        self._last = self.due
        return True

    def passed(self) -> None:
        """Count a tick."""
        self._count_from(self._start, self._count + 1)
        self._drop_missed(time.monotonic())

    def _drop_missed(self, now: float) -> None:
        if now > self.due + _LATE and self._rate < inf:
            self._count_from(self.due + period(now - self.due, self._rate) / self._rate, 1)
