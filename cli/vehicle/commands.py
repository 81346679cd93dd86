"""`hold`, `reset`, `calibrate` and `cage on`, `off` and `show`."""

import time
from typing import Annotated

from msgspec import to_builtins

from quadctl.cli import context, output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.schemas.messages import SafetyState
from quadctl.schemas.services import HoldRequest, ResetRequest, ToggleCageRequest
from quadctl.schemas.topics import HOLD, RESET, STATE, TOGGLE_CAGE, ZONES
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError
from quadctl.vehicle import Vehicle

_HECTOPASCALS_PER_METRE = 0.12
_FAR = 0.08
"""Spread (hPa) of a calibration's samples that no noise makes, but a climb of 0.7 m."""


def calibrate(
    options: Options, unset: Annotated[bool, Option("Drop the baseline.")] = False
) -> None:
    """Zero the barometer at the mean of its last second.

    Example: quadctl calibrate
    """
    with context.connect(options) as client:
        found = Vehicle(client).calibrate(unset=unset)
    if options.json:
        output.document(found)
    else:
        output.line(f"baseline: {found.baseline:.4f} hPa")
    if found.samples and not options.json:
        output.line(f"the mean of {found.samples} samples, spread {found.spread:.1g} hPa")
    if found.spread > _FAR:
        metres = found.spread / _HECTOPASCALS_PER_METRE
        output.note(
            f"warning: the samples spread too far for a zero, as over {metres:.1f} m of height: is the"
            " vehicle climbing? calibrate again in a hover"
        )


def hold(options: Options) -> None:
    """Stop, and hover at the stopping point.

    Example: quadctl hold
    """
    with context.connect(options) as client:
        reply = client.call(HOLD, HoldRequest())
    output.either(options, reply, "stopping: hovering at the stopping point")


def reset(options: Options) -> None:
    """Put the vehicle back at its start, as a new boot of the simulation.

    Example: quadctl reset
    """
    with context.connect(options) as client:
        reply = client.call(RESET, ResetRequest())
    output.either(options, reply, "the vehicle is back at its start")


_LOOK = 0.3
"""Longest wait (s) for the state before: safety answers in milliseconds, also from afar."""


def on(options: Options) -> None:
    """Turn the cage on; a flight to a goal outside is stopped.

    Example: quadctl cage on
    """
    _toggle(options, cage_on=True)


def off(options: Options) -> None:
    """Turn the cage and its zones off: every goal above the floor is accepted.

    Example: quadctl cage off
    """
    _toggle(options, cage_on=False)


def show(options: Options) -> None:
    """Show the bounds and the zones, and whether the cage is on.

    Example: quadctl cage show
    """
    with context.connect(options) as client:
        state = client.latest(STATE)
        # A safety of one's own may have none.
        has_zones = any(offer.name == ZONES.name for offer in client.endpoints("@pub"))
        zones = [zone.params for zone in client.latest(ZONES).zones] if has_zones else ()
    size = state.cage
    axes = {"x": [-size.x, size.x], "y": [-size.y, size.y], "z": [0.0, size.z]}
    if options.json:
        output.document({"on": state.cage_on, **axes, "zones": to_builtins(zones)})
        return
    output.line(f"cage is {'on' if state.cage_on else 'off'}")
    for axis, (low, high) in axes.items():
        output.line(f"cage {axis} - [{low}, {high}]")
    for zone in zones:
        output.line(f"{zone.kind} zone {zone.name}")


def _toggle(options: Options, *, cage_on: bool) -> None:
    with context.connect(options) as client:
        ends = time.monotonic() + client.timeout
        # Only turning the cage on stops a flight, and only the text output reports it.
        before = _current_state(client) if cage_on and not options.json else None
        left = max(ends - time.monotonic(), 0.001)
        reply = client.call(TOGGLE_CAGE, ToggleCageRequest(cage_on), left)
        after = client.latest(STATE) if before is not None else None
    if options.json:
        output.document(reply)
        return
    output.line(f"cage is {'on' if cage_on else 'off'}")
    if before and after and (reason := _stop_reason(before, after)):
        output.line(reason)


def _current_state(client: Client) -> SafetyState | None:
    """Return the current state; None if it does not come at once, as the cage must not wait."""
    try:
        return client.beside(client.vehicle, min(_LOOK, client.timeout / 4)).latest(STATE)
    except QuadctlError:
        return None


def _stop_reason(before: SafetyState, after: SafetyState) -> str:
    """Return why turning the cage on has stopped a flight; empty if it was on or stopped none.

    An unchanged reason is an old one, of a refused request or an earlier flight.
    """
    is_new = not before.cage_on and after.cage_on and after.reason != before.reason
    return after.reason if is_new else ""
