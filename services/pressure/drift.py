"""A slow wandering: the first-order Gauss-Markov process."""

import math

from services.pressure.draws import Draws


class Drift:
    """Wanders about 0 with a standard deviation of 1, at any times and just as likely at all.

    x(t + dt) = a x(t) + sqrt(1 - a^2) n, a = exp(-dt / time), n standard normal: exact for every
    dt, so that neither the rate of readings nor a missed one changes what it is like.
    """

    def __init__(self, time: float) -> None:
        """`time` is the time constant, s: after it, 1/e of the correlation is left."""
        self._time = time
        self._stamp = self._value = 0.0

    def begin(self, stamp: float, draws: Draws) -> None:
        """Start at a time (s) as if it had wandered for ever."""
        self._stamp, self._value = stamp, draws.gauss(0, 1)

    def at(self, stamp: float, draws: Draws) -> float:
        """Where it is at a later time, s."""
        passed = (stamp - self._stamp) / self._time
        kept, new = math.exp(-passed), math.sqrt(-math.expm1(-2 * passed))
        self._stamp, self._value = stamp, kept * self._value + new * draws.gauss(0, 1)
        return self._value
