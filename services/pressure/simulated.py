"""Simulated sensor: standard atmosphere, noise, drift, real parts. Pure.

The maximum rate of each part limits a parameter, and is in `schemas/barometer.py`. Temperature
coefficients are left out, because nothing here has a temperature, and so is the lag of a part's own
filter; the noise includes the effect of the filter.
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
    """Return the static pressure (hPa) at a geometric height (m), up to 11 km (troposphere).

    p = 1013.25 (1 - 0.0065 h / 288.15)^5.255876: U.S. Standard Atmosphere 1976, eq. 33a.
    """
    return float(_SEA_LEVEL * (1 - _LAPSE * height / _TEMPERATURE) ** _EXPONENT)


class NoiseSource(Protocol):
    """Stream of random numbers, such as a seeded `random.Random`."""

    def uniform(self, a: float, b: float, /) -> float:
        """Return a uniformly distributed number in [a, b]."""

    def gauss(self, mu: float, sigma: float, /) -> float:
        """Return a normally distributed number."""


class Drift:
    """Stationary random drift about 0 with a standard deviation of 1, for any times.

    x(t + dt) = a x(t) + sqrt(1 - a^2) n, a = exp(-dt / time), n standard normal: exact for every
    dt, so neither the rate of readings nor a missed one changes its statistics.
    """

    def __init__(self, time: float) -> None:
        """Use a time constant (s), after which 1/e of the correlation is left."""
        self._time = time
        self._stamp = self._value = 0.0

    def begin(self, stamp: float, draws: NoiseSource) -> None:
        """Start at a time (s) in the stationary distribution."""
        self._stamp, self._value = stamp, draws.gauss(0, 1)

    def at(self, stamp: float, draws: NoiseSource) -> float:
        """Return the value at a later time, s."""
        passed = (stamp - self._stamp) / self._time
        kept, new = math.exp(-passed), math.sqrt(-math.expm1(-2 * passed))
        self._stamp, self._value = stamp, kept * self._value + new * draws.gauss(0, 1)
        return self._value


DRIFT = 10.0
"""Drift of the zero, Pa, one sigma, in all parts. Data sheets give it only for years (MS5611: 100
Pa a year), not for hours; indoor air and a warming sensor cause tens of pascals."""
DRIFT_TIME = 1000.0
"""Time constant of the drift, s: steady over a calibration, not over a long flight."""


class Part(NamedTuple):
    """Properties of a barometer from its data sheet."""

    noise: float
    """Noise of a single reading, Pa, RMS; Gaussian and white."""
    resolution: float
    """Step of the readings, Pa."""
    accuracy: float
    """Greatest error, Pa, either way: the bias of a boot is uniform within it."""


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
"""Pascals in one hPa."""


class Simulated:
    """Raw readings, before any calibration."""

    def __init__(
        self, params: PressureParams, lab: NoiseSource, stream: Callable[[str], NoiseSource]
    ) -> None:
        """Use `lab` for the noise of the profile lab, and `stream` for further streams by name."""
        self._params, self._lab = params, lab
        # Boots have their own stream: a boot's bias does not depend on the length of the last one.
        self._boots, self._noise = stream("boots"), stream("noise")
        self._boot, self._bias, self._drift = "", 0.0, Drift(DRIFT_TIME)

    def read(self, boot: str, stamp: float, height: float) -> float:
        """Return the pressure (hPa) that the sensor measures at a height (m).

        A new `boot` switches the sensor on again; `stamp` is its time, s. Profiles change at once.
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
