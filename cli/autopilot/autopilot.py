"""`autopilot`: the process in the place of dynamics, in the place of the command."""

import sys
from pathlib import Path
from typing import Annotated

from quadctl.cli import output
from quadctl.cli.autopilot import calibration
from quadctl.cli.bridge.extras import require
from quadctl.cli.bridge.mavlink import check_origin, plainly
from quadctl.cli.bridge.process import run_instead
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.security import bridge_access

_ADDRESS = "udpin:127.0.0.1:14540"


def autopilot(
    options: Options,
    action: Annotated[str, Arg("`calibrate`: measure how the autopilot flies.")] = "",
    origin: Annotated[
        tuple[float, float, float] | None,
        Option("Place of our origin: degrees, and m above mean sea level.", metavar="LAT LON ALT"),
    ] = None,
    signing_key: Annotated[
        Path | None, Option("Sign packets, and refuse others: 32 bytes or a passphrase.")
    ] = None,
    no_fence: Annotated[bool, Option("Fly without a fence in the autopilot.")] = False,
    distance: Annotated[float, Option("Metres of a calibration's flights.")] = 2.0,
) -> None:
    """Fly an autopilot that speaks MAVLink, behind the cage, in the place of dynamics.

    Its address is that of --connect, by default udpin:127.0.0.1:14540. A line of quad.toml,
    `[processes] dynamics = "quadctl autopilot --origin LAT LON ALT"`, runs it by `quadctl up`. It never
    arms the autopilot and never changes its mode: the pilot does both. `autopilot calibrate` flies to
    and fro, and prints the parameters that declare how the autopilot flies.

    Example: quadctl autopilot --connect udpin:127.0.0.1:14540 --origin 47.397742 8.545594 488
    """
    if action == "calibrate":
        calibration.calibrate(options, distance)
        return
    if action:
        raise UsageError(f"autopilot {action}: no such word", "`autopilot calibrate`, or none")
    require("mavlink")
    if origin is None:
        raise UsageError(
            "--origin is missing: where is the cage's centre on the ground?",
            "--origin LAT LON ALT, in degrees and m above mean sea level",
        )
    check_origin(origin)
    given = options.connect or _ADDRESS
    address = bridge_access.autopilot_address_of(given)
    signed = signing_key is not None
    bridge_access.check_peer(address, f"--connect {given}", signed=signed)
    command = [sys.executable, "-P", "-m", "quadctl.services.mavlink.autopilot"]
    command += ["--connect", given, "--origin", *map(plainly, origin), "--realm", options.realm]
    if signing_key:
        bridge_access.key_of(signing_key)
        command += ["--signing-key", str(signing_key.resolve())]
    command += ["--no-fence"] if no_fence else []
    command += ["--vehicle", options.named] if options.named else []
    output.note("the pilot arms, and changes the mode to OFFBOARD or GUIDED; safety then flies")
    run_instead(command)
