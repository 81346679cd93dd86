"""`autopilot`: the process in the place of dynamics, in the place of the command."""

from pathlib import Path
from typing import Annotated

from quadctl.cli import output
from quadctl.cli.bridge.process import command_of, require, run_instead
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option
from quadctl.services.bridges.options import AutopilotOptions
from quadctl.services.runtime.errors import UsageError


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
        from quadctl.cli.autopilot.calibration import calibrate

        calibrate(options, distance)
        return
    if action:
        raise UsageError(f"autopilot {action}: no such word", "`autopilot calibrate`, or none")
    require("mavlink")
    given = AutopilotOptions(
        options.connect or AutopilotOptions().address,
        origin or (),
        str(signing_key or ""),
        fenced=not no_fence,
    )
    given.check()
    command = command_of("mavlink.autopilot", options, given)
    command += ["--vehicle", options.named] if options.named else []
    output.note("the pilot arms, and changes the mode to OFFBOARD or GUIDED; safety then flies")
    run_instead(command)
