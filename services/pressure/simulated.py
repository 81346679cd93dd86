"""Simulated sensor: standard atmosphere, noise, drift, real parts. Pure.

The readings per second of each part bound a parameter, and stand in `schemas/barometer.py`.
Temperature coefficients are left out, since nothing here has a temperature that they could act on,
and so is the lag of a part's own filter; what the filter does to the noise is in the noise.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from quadctl.schemas.barometer import PressureParams, Profile

_SEA_LEVEL = 1013.25
"""Pressure at height 0, hPa."""
_TEMPERATURE = 288.15
"""Temperature at height 0, K."""
_LAPSE = 0.0065
"""Loss of temperature with height, K/m."""
_EXPONENT = 5.255876
"""g M / (R L), a pure number."""


def pressure_at(height: float) -> float:
    """Static pressure (hPa) at a geometric height (m) in the troposphere, up to 11 km.

    p = 1013.25 (1 - 0.0065 h / 288.15)^5.255876: U.S. Standard Atmosphere 1976, eq. 33a.
    """
    return float(_SEA_LEVEL * (1 - _LAPSE * height / _TEMPERATURE) ** _EXPONENT)


class NoiseSource(Protocol):
    """A stream of random numbers, such as a seeded `random.Random`."""

    def uniform(self, a: float, b: float, /) -> float:
        """A number in [a, b], all equally likely."""

    def gauss(self, mu: float, sigma: float, /) -> float:
        """A number of the normal distribution."""


class Drift:
    """Wanders about 0 with a standard deviation of 1, at any times and just as likely at all.

    x(t + dt) = a x(t) + sqrt(1 - a^2) n, a = exp(-dt / time), n standard normal: exact for every
    dt, so that neither the rate of readings nor a missed one changes what it is like.
    """

    def __init__(self, time: float) -> None:
        """`time` is the time constant, s: after it, 1/e of the correlation is left."""
        self._time = time
        self._stamp = self._value = 0.0

    def begin(self, stamp: float, draws: NoiseSource) -> None:
        """Start at a time (s) as if it had wandered for ever."""
        self._stamp, self._value = stamp, draws.gauss(0, 1)

    def at(self, stamp: float, draws: NoiseSource) -> float:
        """Where it is at a later time, s."""
        passed = (stamp - self._stamp) / self._time
        kept, new = math.exp(-passed), math.sqrt(-math.expm1(-2 * passed))
        self._stamp, self._value = stamp, kept * self._value + new * draws.gauss(0, 1)
        return self._value


DRIFT = 10.0
"""How far the zero wanders, Pa, one sigma, in all parts: no data sheet says it for hours, only for
years (MS5611: 100 Pa a year); tens of pascals are what indoor air and a warming sensor do."""
DRIFT_TIME = 1000.0
"""Time constant of that wandering, s: steady over a calibration, not over a long flight."""


class Part(NamedTuple):
    """A barometer as its data sheet has it."""

    noise: float
    """Of a single reading, Pa, RMS; Gaussian and white."""
    resolution: float
    """Readings are whole multiples of this, Pa."""
    accuracy: float
    """How far off a sensor may be, Pa, either way: the bias of a boot is uniform within it."""


PARTS: dict[Profile, Part] = {
    # TE Connectivity, MS5611-01BA03: resolution RMS 0.012 mbar at OSR 4096; its formula for P
    # ends in whole hundredths of a mbar; accuracy +-1.5 mbar at 25 degrees C and 750 mbar.
    "ms5611": Part(noise=1.2, resolution=1.0, accuracy=150.0),
    # Bosch Sensortec, BST-BMP280-DS001: noise 0.2 Pa (1.6 cm) at x16 oversampling with filter 16,
    # tables 7 and 15; 20 bit or 0.16 Pa, table 4; absolute accuracy +-1 hPa, key parameters.
    "bmp280": Part(noise=0.2, resolution=0.16, accuracy=100.0),
    # Bosch Sensortec, BST-BMP388-DS001: noise 0.03 Pa at best, with the lowest bandwidth and the
    # highest resolution (its setting for drones, x8 at 50 Hz, has 11 cm, 1.3 Pa); absolute
    # accuracy +-50 Pa. Hundredths of a pascal are what Bosch's own integer driver gives.
    "bmp388": Part(noise=0.03, resolution=0.01, accuracy=50.0),
}


_PASCALS = 100.0
"""In one hPa."""


class Simulated:
    """Raw readings, before any calibration."""

    def __init__(
        self, params: PressureParams, lab: NoiseSource, stream: Callable[[str], NoiseSource]
    ) -> None:
        """`lab` is the noise of the profile lab; `stream` makes further streams, one by one name."""
        self._params, self._lab = params, lab
        # What a boot brings has a stream of its own: it does not hang on how long the last one was.
        self._boots, self._noise = stream("boots"), stream("noise")
        self._boot, self._bias, self._drift = "", 0.0, Drift(DRIFT_TIME)

    def read(self, boot: str, stamp: float, height: float) -> float:
        """The pressure (hPa) that the sensor shows at a height (m).

        `boot` names the simulation's boot, with which the sensor is switched on anew, and `stamp`
        is its time, s. The profile may change at any time, and counts from the next reading.
        """
        air = pressure_at(height)
        part = PARTS.get(self._params.profile)
        if part is None:
            return air + self._params.noise * self._lab.uniform(-1, 1)
        if boot != self._boot:
            self._boot, self._bias = boot, self._boots.uniform(-1, 1)
            self._drift.begin(stamp, self._boots)
        wandered = DRIFT * self._drift.at(stamp, self._noise)
        noise = self._noise.gauss(0, part.noise)
        pascals = air * _PASCALS + part.accuracy * self._bias + wandered + noise
        return round(pascals / part.resolution) * part.resolution / _PASCALS
