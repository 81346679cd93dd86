"""`cage on|off|show`: the virtual cage."""

import typer

from cli import bus, options, output
from cli.options import Command

app = typer.Typer(help="The virtual cage.")


def _toggle(ctx: typer.Context, *, cage_on: bool) -> None:
    from schemas.requests import ToggleCageRequest
    from schemas.topics import STATE, TOGGLE_CAGE

    with bus.connect(ctx) as client:
        reply = client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on))
        reason = client.latest(STATE).reason
    if options.of(ctx).json:
        output.document(reply)
        return
    output.line(f"cage is {'on' if cage_on else 'off'}")
    if reason and cage_on:
        output.line(reason)


@app.command(cls=Command)
def on(ctx: typer.Context) -> None:
    """Turn the cage on; a flight to a goal outside is stopped.

    Example: quadctl cage on
    """
    _toggle(ctx, cage_on=True)


@app.command(cls=Command)
def off(ctx: typer.Context) -> None:
    """Turn the cage off: every goal is accepted.

    Example: quadctl cage off
    """
    _toggle(ctx, cage_on=False)


@app.command(cls=Command)
def show(ctx: typer.Context) -> None:
    """Show the bounds, and whether the cage is on.

    Example: quadctl cage show
    """
    from schemas.topics import STATE

    with bus.connect(ctx) as client:
        state = client.latest(STATE)
    size = state.cage
    axes = {"x": [-size.x, size.x], "y": [-size.y, size.y], "z": [0.0, size.z]}
    if options.of(ctx).json:
        output.document({"on": state.cage_on, **axes})
        return
    output.line(f"cage is {'on' if state.cage_on else 'off'}")
    for axis, (low, high) in axes.items():
        output.line(f"cage {axis} - [{low}, {high}]")
