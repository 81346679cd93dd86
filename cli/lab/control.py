"""`hold`, `reset`."""

from cli import bus, output
from cli.options import Options
from schemas.services import HoldRequest, ResetRequest
from schemas.topics import HOLD, RESET


def hold(options: Options) -> None:
    """Stop, and hover at the stopping point.

    Example: quadctl hold
    """
    with bus.connect(options) as client:
        reply = client.call(HOLD, HoldRequest())
    output.either(options, reply, "stopping: hovering at the stopping point")


def reset(options: Options) -> None:
    """Put the vehicle back at its start, as a new boot of the simulation.

    Example: quadctl reset
    """
    with bus.connect(options) as client:
        reply = client.call(RESET, ResetRequest())
    output.either(options, reply, "the vehicle is back at its start")
