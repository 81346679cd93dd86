"""`hold`, `reset`, `state`."""

import typer

from cli import bus, options, output


def hold(ctx: typer.Context) -> None:
    """Stop, and hover at the stopping point.

    Example: quadctl hold
    """
    from schemas.requests import HoldRequest
    from schemas.topics import HOLD

    with bus.connect(ctx) as client:
        reply = client.call(HOLD, HoldRequest())
    if options.of(ctx).json:
        output.document(reply)
    else:
        output.line("stopping: hovering at the stopping point")


def reset(ctx: typer.Context) -> None:
    """Put the vehicle back at its start, as a new boot of the simulation.

    Example: quadctl reset
    """
    from schemas.requests import ResetRequest
    from schemas.topics import RESET

    with bus.connect(ctx) as client:
        reply = client.call(RESET, ResetRequest())
    if options.of(ctx).json:
        output.document(reply)
    else:
        output.line("the vehicle is back at its start")


def state(ctx: typer.Context) -> None:
    """Show what the automaton is doing, and where the vehicle is.

    Example: quadctl state --json
    """
    import msgspec

    from schemas.topics import POSE, STATE

    with bus.connect(ctx) as client:
        now, pose = client.latest(STATE), client.first(POSE)
    shown = msgspec.to_builtins(now) | {"pose": msgspec.to_builtins(pose)}
    if options.of(ctx).json:
        output.document(shown)
    else:
        output.fields(shown)
