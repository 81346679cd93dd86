"""The simulated sensor: the air at a height, as the lab's ideal sensor or a real part shows it."""

from collections.abc import Callable

from schemas.barometer import PressureParams
from services.pressure.atmosphere import pressure_at
from services.pressure.draws import Draws
from services.pressure.drift import Drift
from services.pressure.profiles import DRIFT, DRIFT_TIME, PARTS, Part

_PASCALS = 100.0
"""In one hPa."""


class Simulated:
    """Raw readings, before any calibration."""

    def __init__(self, params: PressureParams, lab: Draws, stream: Callable[[str], Draws]) -> None:
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
        return self._shown(part, air, stamp)

    def _shown(self, part: Part, air: float, stamp: float) -> float:
        wandered = DRIFT * self._drift.at(stamp, self._noise)
        noise = self._noise.gauss(0, part.noise)
        pascals = air * _PASCALS + part.accuracy * self._bias + wandered + noise
        return round(pascals / part.resolution) * part.resolution / _PASCALS
