"""Parameters of the barometer: the sensor and its faults."""

from typing import Annotated, Literal

from msgspec import Struct, field

from quadctl.schemas.units import described

Profile = Literal["lab", "ms5611", "bmp280", "bmp388"]

MOST_RATE = {"ms5611": 100.0, "bmp280": 26.3, "bmp388": 200.0}
"""Maximum rate of each part, Hz; `services/pressure/simulated.py` has its other properties. MS5611:
one conversion of 9.04 ms at OSR 4096 each (MS5611-01BA03 data sheet, analog digital converter).
BMP280: x16 oversampling, with temperature (BST-BMP280-DS001, table 7). BMP388: its highest output
data rate (BST-BMP388-DS001, register ODR)."""

LAB_NOISE = 1e-5

AIR = (250.0, 1250.0)
"""Range of air pressure, hPa: from 10 km up, the lab's limit, to the most that parts measure."""


class FaultParams(Struct, forbid_unknown_fields=True):
    """Faults of the barometer."""

    kind: Annotated[
        Literal["none", "stuck", "off", "glitch", "delay"],
        described(
            "stuck: the last value repeated; off: no readings; glitch: random spikes;"
            " delay: old values"
        ),
    ] = "none"
    magnitude: Annotated[float, described("glitch size, up or down", "hPa", ge=0, le=100)] = 1.0
    interval: Annotated[float, described("mean time between glitches", "s", ge=0.01, le=3600)] = 1.0
    delay: Annotated[float, described("age of delayed values", "s", ge=0, le=10)] = 1.0


class PressureParams(Struct, forbid_unknown_fields=True):
    """The barometer."""

    source: Annotated[
        Literal["sim", "iio"],
        described(
            "sim: the air at the vehicle's height; iio: a real sensor on this machine, through"
            " Linux IIO"
        ),
    ] = "sim"
    iio: Annotated[
        str,
        described(
            "folder of the real sensor, such as /sys/bus/iio/devices/iio:device0; empty: the"
            " first one with pressure"
        ),
    ] = ""
    profile: Annotated[
        Profile,
        described("the lab's ideal sensor, or a real part with its noise, steps, bias and drift"),
    ] = "lab"
    rate: Annotated[
        float,
        described(
            "readings per second; the parts allow at most:"
            f" {', '.join(f'{part} {most:g}' for part, most in MOST_RATE.items())}",
            "Hz",
            gt=0,
            le=200,
        ),
    ] = 10.0
    noise: Annotated[
        float, described("half-width of the uniform noise of the profile lab", "hPa", ge=0, le=10)
    ] = LAB_NOISE
    fault: FaultParams = field(default_factory=FaultParams)

    def __post_init__(self) -> None:
        """Raise ValueError for values that the part cannot have, or that would be ignored."""
        most = MOST_RATE.get(self.profile)
        if most is not None and self.rate > most:
            raise ValueError(
                f"rate {self.rate:g} Hz: a {self.profile} gives at most {most:g} readings a second"
            )
        if self.profile != "lab" and self.noise != LAB_NOISE:
            raise ValueError(
                f"noise {self.noise:g} hPa is for the profile lab: a {self.profile} has its own;"
                f" leave noise at {LAB_NOISE:g}, or set the profile to lab"
            )
        if self.iio and not self.iio.startswith("/"):
            raise ValueError(f"iio: '{self.iio}' is not a full path, which begins with /")
