"""`bridge ros2`: the process of the bridge, in the place of the command."""

import os
from typing import Annotated

from quadctl.cli.bridge.extras import require
from quadctl.cli.bridge.process import become
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.security.endpoints import check

DOMAIN = "ROS_DOMAIN_ID"
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
    number = _domain(domain)
    check(router)
    words = ["--router", router, "--domain", str(number)]
    become("ros2", options, words, {"router": router, "domain": number})


def _domain(given: int | None) -> int:
    """Return the domain of the option, else of the environment; raise UsageError for a wrong one."""
    text = str(given) if given is not None else os.environ.get(DOMAIN) or "0"
    if not text.isdecimal() or int(text) > _MOST:
        what = f"--domain {text}" if given is not None else f"{DOMAIN}={text}"
        raise UsageError(f"{what}: there is no such domain", f"0 to {_MOST}")
    return int(text)
