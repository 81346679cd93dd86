"""A command's connection, made from its common options."""

from cli.options import Options
from services.runtime.bus.client import Client


def connect(options: Options) -> Client:
    """Connect to the hub that the options name; raises Unreachable when there is none."""
    return Client(options.realm, options.vehicle, connect=options.connect, timeout=options.timeout)
