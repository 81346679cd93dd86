"""`bridge ros2`: the process of the bridge, in the place of the command."""

from typing import Annotated

from quadctl.cli.bridge.process import become
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.services.bridges.options import Ros2Options


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
    given = Ros2Options(router, domain)
    become("ros2", options, given, {"router": router, "domain": given.number})
