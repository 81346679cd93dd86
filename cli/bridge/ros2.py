"""`bridge ros2`: the process of the bridge, in the place of the command."""

import os
import sys
from typing import Annotated

from quadctl.cli import context, output
from quadctl.cli.bridge.extras import require
from quadctl.cli.context import Options, listed_vehicles, with_any_vehicle
from quadctl.cli.declarations import Option
from quadctl.services.runtime.errors import UsageError

_MOST = 232
"""Largest domain of ROS, whose ports end there."""


def ros2(
    options: Options,
    domain: Annotated[
        int | None, Option("Domain of ROS (env ROS_DOMAIN_ID, default: 0).", metavar="N")
    ] = None,
    router: Annotated[
        str, Option("Endpoint of the router of rmw_zenoh.", metavar="ENDPOINT")
    ] = "tcp/127.0.0.1:7447",
) -> None:
    """Show the vehicle in ROS 2 and fly it from there, until Ctrl-C; needs rmw_zenoh's router.

    Topics, services and frames are in the namespace of the vehicle. A router that is not there yet,
    or is lost, is joined again by itself.

    Example: quadctl bridge ros2 --domain 0
    """
    require("ros2")
    if domain is not None and not 0 <= domain <= _MOST:
        raise UsageError(f"--domain {domain}: there is no such domain", f"0 to {_MOST}")
    vehicles = listed_vehicles(options)
    options = with_any_vehicle(options)
    with context.connect(options) as client:
        # Fail here, with a better message than the bridge's, without a hub.
        client.flush()
    command = [sys.executable, "-P", "-m", "quadctl.services.ros2", "--router", router]
    command += ["--domain", str(domain)] if domain is not None else []
    command += ["--realm", options.realm]
    command += ["--connect", options.connect] if options.connect else []
    command += [word for vehicle in vehicles for word in ("--vehicle", vehicle)]
    if options.json:
        output.document({"router": router, "vehicles": vehicles})
    else:
        output.note("Ctrl-C ends the bridge; the vehicle keeps flying")
    sys.stdout.flush()
    # One process: whoever ends the command ends the bridge.
    os.execv(sys.executable, command)  # noqa: S606 - our own interpreter, no shell
