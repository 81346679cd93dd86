"""`bridge mavlink`: the process of the bridge, in the place of the command."""

from math import isfinite
from pathlib import Path
from typing import Annotated

from quadctl.cli.bridge.extras import require
from quadctl.cli.bridge.process import become
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.security import datagrams

_NEAREST_POLE = 89.0
"""Latitude beyond which a flat earth has no east."""


def mavlink(
    options: Options,
    to: Annotated[
        str, Option("Address of a ground station that listens.", metavar="udpout:HOST:PORT")
    ] = "udpout:127.0.0.1:14550",
    origin: Annotated[
        tuple[float, float, float] | None,
        Option(
            "Place of our origin: degrees, and m above mean sea level"
            " (default: 47.397742 8.545594 488).",
            metavar="LAT LON ALT",
        ),
    ] = None,
    signing_key: Annotated[
        Path | None, Option("Sign packets, and refuse others: 32 bytes or a passphrase.")
    ] = None,
) -> None:
    """Show the vehicle to QGroundControl or MAVSDK, and fly it from there, until Ctrl-C.

    The vehicle looks like a PX4; of several vehicles each is a system, with the numbers 1, 2 .. A
    ground station may start earlier or later. One on another machine needs --signing-key.

    Example: quadctl bridge mavlink --to udpout:127.0.0.1:14540
    """
    require("mavlink")
    datagrams.check(to, signed=signing_key is not None)
    if signing_key:
        datagrams.key_of(signing_key)
    words = ["--to", to]
    words += ["--origin", *map(repr, _checked(origin))] if origin else []
    words += ["--signing-key", str(signing_key.resolve())] if signing_key else []
    become(
        "mavlink",
        options,
        words,
        {"to": to},
        f"a ground station that listens on UDP port {to.rpartition(':')[2]} finds it",
    )


def _checked(origin: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a place on the earth; raise UsageError for another."""
    latitude, longitude, altitude = origin
    for name, value, bound, unit in (
        ("latitude", latitude, _NEAREST_POLE, "degrees"),
        ("longitude", longitude, 180.0, "degrees"),
        ("altitude", altitude, 10_000.0, "m"),
    ):
        if not (isfinite(value) and abs(value) <= bound):
            raise UsageError(f"--origin: {name} {value:g}", f"-{bound:g} to {bound:g} {unit}")
    return origin
