"""`cage on|off|show`: the virtual cage."""

from cli import bus, output
from cli.options import Options
from schemas.requests import ToggleCageRequest
from schemas.topics import STATE, TOGGLE_CAGE


def on(options: Options) -> None:
    """Turn the cage on; a flight to a goal outside is stopped.

    Example: quadctl cage on
    """
    _toggle(options, cage_on=True)


def off(options: Options) -> None:
    """Turn the cage off: every goal is accepted.

    Example: quadctl cage off
    """
    _toggle(options, cage_on=False)


def show(options: Options) -> None:
    """Show the bounds, and whether the cage is on.

    Example: quadctl cage show
    """
    with bus.connect(options) as client:
        state = client.latest(STATE)
    size = state.cage
    axes = {"x": [-size.x, size.x], "y": [-size.y, size.y], "z": [0.0, size.z]}
    if options.json:
        output.document({"on": state.cage_on, **axes})
        return
    output.line(f"cage is {'on' if state.cage_on else 'off'}")
    for axis, (low, high) in axes.items():
        output.line(f"cage {axis} - [{low}, {high}]")


def _toggle(options: Options, *, cage_on: bool) -> None:
    with bus.connect(options) as client:
        reply = client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on))
        reason = client.latest(STATE).reason
    if options.json:
        output.document(reply)
        return
    output.line(f"cage is {'on' if cage_on else 'off'}")
    if reason and cage_on:
        output.line(reason)
