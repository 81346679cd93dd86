"""`bridge mavlink`: the process of the bridge, in the place of the command."""

from pathlib import Path
from typing import Annotated

from quadctl.cli.bridge.process import become
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.services.bridges.options import MavlinkOptions


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
    become(
        "mavlink",
        options,
        MavlinkOptions(to, origin or (), str(signing_key or "")),
        {"to": to},
        f"a ground station that listens on UDP port {to.rpartition(':')[2]} finds it",
    )
