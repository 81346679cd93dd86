"""`bridge mavlink`: the process of the bridge, in the place of the command."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from quadctl.cli.bridge.extras import require
from quadctl.cli.bridge.process import become
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.schemas.earth import origin_of
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.security import bridge_access


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
    check_origin(origin or ())
    address = bridge_access.address_of(to)
    bridge_access.check_peer(address, f"--to {to}", signed=signing_key is not None)
    if signing_key:
        bridge_access.key_of(signing_key)
    words = ["--to", to]
    words += ["--origin", *map(plainly, origin)] if origin else []
    words += ["--signing-key", str(signing_key.resolve())] if signing_key else []
    become(
        "mavlink",
        options,
        words,
        {"to": to},
        f"a ground station that listens on UDP port {to.rpartition(':')[2]} finds it",
    )


def plainly(number: float) -> str:
    """Return a number without an exponent, which a parser of options takes for an option."""
    return f"{number:.9f}"


def check_origin(numbers: Sequence[float]) -> None:
    """Raise UsageError for latitude, longitude and height that are no place on earth."""
    try:
        origin_of(numbers)
    except ValueError as error:
        raise UsageError(
            f"--origin: {error}", "-89 to 89 degrees, -180 to 180 degrees, -1000 to 10 000 m"
        ) from error
