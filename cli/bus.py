"""A command's connection, made from its common options."""

from typing import TYPE_CHECKING

from cli.options import Options

if TYPE_CHECKING:
    from services.runtime.bus.client import Client


def connect(options: Options) -> "Client":
    """Connect to the hub that the options name; raises Unreachable when there is none."""
    # Imported here: a line that needs no bus is read in half the time.
    from services.runtime.bus.client import Client

    return Client(options.realm, options.vehicle, connect=options.connect, timeout=options.timeout)
