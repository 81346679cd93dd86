"""`cage on|off|show`: the virtual cage."""

import time

from cli import bus, output
from cli.options import Options
from schemas.messages import SafetyState
from schemas.services import ToggleCageRequest
from schemas.topics import STATE, TOGGLE_CAGE
from services.runtime.bus.client import Client
from services.runtime.errors import QuadctlError

_LOOK = 0.3
"""Seconds at most for a look at what was before: safety answers in milliseconds, also from afar."""


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
        ends = time.monotonic() + client.timeout
        # Only a cage that comes on stops a flight, and only a user is told of it.
        before = _seen(client) if cage_on and not options.json else None
        left = max(ends - time.monotonic(), 0.001)
        reply = client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on), left)
        after = client.latest(STATE) if before is not None else None
    if options.json:
        output.document(reply)
        return
    output.line(f"cage is {'on' if cage_on else 'off'}")
    if before and after and (reason := _caused(before, after)):
        output.line(reason)


def _seen(client: Client) -> SafetyState | None:
    """The state as it is; None where it is not to be had at once, for the cage must not wait."""
    try:
        return client.beside(client.vehicle, min(_LOOK, client.timeout / 4)).latest(STATE)
    except QuadctlError:
        return None


def _caused(before: SafetyState, after: SafetyState) -> str:
    """What the cage's coming on has stopped; empty where it was on, or stopped nothing.

    The reason may be an old one, of a request that was refused or a flight that was stopped.
    """
    is_new = not before.cage_on and after.cage_on and after.reason != before.reason
    return after.reason if is_new else ""
