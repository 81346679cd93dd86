"""`calibrate`: the barometer."""

import time
from typing import Annotated

import typer

from cli import bus, options, output


def calibrate(
    ctx: typer.Context,
    unset: Annotated[bool, typer.Option("--unset", help="Drop the baseline.")] = False,
) -> None:
    """Zero the barometer at the mean of its last second.

    Example: quadctl calibrate
    """
    from schemas.messages import Pressure
    from schemas.requests import CalibrateRequest
    from schemas.topics import CALIBRATE, PRESSURE
    from services.runtime import wire

    with bus.connect(ctx) as client:
        readings = client.listen(PRESSURE.key(client.vehicle)) if not unset else None
        reply = client.call(CALIBRATE, CalibrateRequest(zero=not unset))
        samples, spread = 0, 0.0
        deadline = time.monotonic() + client.timeout
        while readings is not None:
            # The topic tells how good the baseline is, from its next message on.
            message = readings.next(deadline - time.monotonic())
            if message is None or time.monotonic() > deadline:
                raise client.silent(PRESSURE.key(client.vehicle))
            reading = wire.decode(Pressure, message.payload, message.encoding)
            if reading.baseline == reply.baseline:
                samples, spread = reading.samples, reading.spread
                break
    if options.of(ctx).json:
        output.document({"baseline": reply.baseline, "samples": samples, "spread": spread})
    else:
        output.line(f"baseline: {reply.baseline:.4f} hPa")
        if samples:
            output.line(f"the mean of {samples} samples, spread {spread:.1g} hPa")
