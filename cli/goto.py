"""`goto`: asks safety for a goal and watches the flight there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cli import bus, options, output
from cli.progress import Progress
from services.runtime.errors import Invalid, QuadctlError, Refused

if TYPE_CHECKING:
    from cli.flying import Flight
    from schemas.requests import GotoRequest
    from services.runtime.client import Client


def goto(
    ctx: typer.Context,
    x: Annotated[float, typer.Argument(help="East, m.")],
    y: Annotated[float, typer.Argument(help="North, m.")],
    z: Annotated[float, typer.Argument(help="Up, m.")],
    no_wait: Annotated[
        bool, typer.Option("--no-wait", help="Return with safety's verdict.")
    ] = False,
    replace: Annotated[
        bool, typer.Option("--replace", help="Change course while flying to another goal.")
    ] = False,
    arrive: Annotated[
        float | None,
        typer.Option(help="Seconds to arrive in (default: twice the planned time and 5)."),
    ] = None,
) -> None:
    """Fly to a point, if safety permits, and wait for the arrival.

    Example: quadctl goto 1 -2 1.5
    """
    from cli.flying import Flight
    from schemas.geometry import Position
    from schemas.topics import GOTO

    if arrive is not None and not 0 < arrive <= options.LONGEST_TIMEOUT:
        raise Invalid(f"--arrive {arrive}: not a time", "give seconds, more than 0")
    request = _request(x, y, z, replace)
    as_json = options.of(ctx).json
    with bus.connect(ctx) as client:
        flight = Flight(client, Position(request.x, request.y, request.z))
        reply = client.call(GOTO, request)
        if not as_json:
            output.line("accepted" if reply.accepted else "rejected")
        problem: QuadctlError | None = None
        if not reply.accepted:
            problem = Refused(reply.reason, "`quadctl cage show` and `quadctl state` say more")
        elif not no_wait:
            problem = _watch(client, flight, arrive, quiet=as_json)
    if as_json:
        output.document(_report(flight, reply.accepted, reply.reason or flight.reason))
    elif flight.arrived:
        output.line(f"arrived within {flight.distance:.2f} m after {flight.seconds:.2f} s")
    if problem is not None:
        raise problem


def _watch(
    client: Client, flight: Flight, arrive: float | None, *, quiet: bool
) -> QuadctlError | None:
    """Show the flight until it ends; returns what kept it from its goal."""
    from cli.flying import distance, patience
    from schemas.topics import POSE

    try:
        start = client.first(POSE).position
        whole = max(distance(start, flight.goal), 1e-6)
        limit = arrive or patience(client, start, flight.goal)
        with Progress("flying", quiet=quiet) as progress:
            flight.watch(
                limit, lambda left: progress.update(1 - left / whole, f"{left:.2f} m to go")
            )
    except QuadctlError as problem:
        return problem
    except KeyboardInterrupt:
        output.note("stopped waiting: the flight goes on; `quadctl hold` stops it")
        raise
    return None


def _report(flight: Flight, accepted: bool, reason: str) -> dict[str, Any]:
    known = math.isfinite(flight.distance)
    return {
        "accepted": accepted,
        "reason": reason,
        "arrived": flight.arrived,
        "distance": flight.distance if known else None,
        "seconds": flight.seconds if known else None,
    }


def _request(x: float, y: float, z: float, replace: bool) -> GotoRequest:
    import msgspec

    from schemas.requests import GotoRequest

    try:
        return msgspec.convert({"x": x, "y": y, "z": z, "replace": replace}, GotoRequest)
    except msgspec.ValidationError as error:
        raise Invalid(
            f"({x}, {y}, {z}) is no point to fly to: {error}",
            "coordinates are metres, finite, and at most 10 km",
        ) from error
