"""What real barometers are like: every number with its unit and where it is from.

How many readings a second each gives bounds a parameter, so it stands in `schemas/barometer.py`.
Temperature coefficients are left out, since nothing here has a temperature that they could act on,
and so is the lag of a part's own filter; what the filter does to the noise is in the noise.
"""

from typing import NamedTuple

from schemas.barometer import Profile

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
