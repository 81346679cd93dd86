"""`calibrate`: the barometer."""

import time
from typing import Annotated

from cli import bus, output
from cli.declare import Opt
from cli.options import Options
from schemas.messages import Pressure
from schemas.services import CalibrateRequest
from schemas.topics import CALIBRATE, PRESSURE
from services.runtime.bus.client import Client
from services.runtime.bus.streams import Readings


def calibrate(options: Options, unset: Annotated[bool, Opt("Drop the baseline.")] = False) -> None:
    """Zero the barometer at the mean of its last second.

    Example: quadctl calibrate
    """
    samples, spread = 0, 0.0
    with bus.connect(options) as client:
        readings = client.hear(PRESSURE) if not unset else None
        baseline = client.call(CALIBRATE, CalibrateRequest(zero=not unset)).baseline
        if readings is not None:
            reading = _reading_with(client, readings, baseline)
            samples, spread = reading.samples, reading.spread
    if options.json:
        output.document({"baseline": baseline, "samples": samples, "spread": spread})
    else:
        output.line(f"baseline: {baseline:.4f} hPa")
        if samples:
            output.line(f"the mean of {samples} samples, spread {spread:.1g} hPa")


def _reading_with(client: Client, readings: Readings[Pressure], baseline: float) -> Pressure:
    """The topic tells how good a baseline is, from its next message on."""
    deadline = time.monotonic() + client.timeout
    while (reading := readings.next(deadline - time.monotonic())) is not None:
        if reading.baseline == baseline:
            return reading
        if time.monotonic() > deadline:
            break
    raise client.silent(PRESSURE.key(client.vehicle), readings.unread)
