"""`goto`: asks safety for a goal and watches the flight there."""

import math
from typing import Annotated, Any

import msgspec

from cli import bus, output
from cli.declare import Arg, Opt
from cli.lab.flying import Flight, patience
from cli.lab.progress import Progress
from cli.options import LONGEST_TIMEOUT, Options
from schemas.messages import Position
from schemas.services import GotoRequest
from schemas.topics import GOTO
from services.runtime.bus.client import Client
from services.runtime.errors import Invalid, QuadctlError, Refused


def goto(
    options: Options,
    x: Annotated[float, Arg("East, m.")],
    y: Annotated[float, Arg("North, m.")],
    z: Annotated[float, Arg("Up, m.")],
    no_wait: Annotated[bool, Opt("Return with safety's verdict.")] = False,
    replace: Annotated[bool, Opt("Change course while flying to another goal.")] = False,
    arrive: Annotated[
        float | None, Opt("Seconds to arrive in (default: twice the planned time and 5).")
    ] = None,
) -> None:
    """Fly to a point, if safety permits, and wait for the arrival.

    Example: quadctl goto 1 -2 1.5
    """
    check_arrive(arrive)
    request = request_of(x, y, z, replace=replace)
    as_json = options.json
    with bus.connect(options) as client:
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


def check_arrive(arrive: float | None) -> None:
    """Raises Invalid for what is no time (s) to arrive in."""
    if arrive is not None and not 0 < arrive <= LONGEST_TIMEOUT:
        raise Invalid(f"--arrive {arrive}: not a time", "give seconds, more than 0")


def _watch(
    client: Client, flight: Flight, arrive: float | None, *, quiet: bool
) -> QuadctlError | None:
    """Show the flight until it ends; returns what kept it from its goal."""
    try:
        flight.begin()
        whole = max(flight.distance, 1e-6)
        limit = arrive or (0 if flight.reason else patience(client, whole))
        with Progress("flying", quiet=quiet) as progress:

            def show(left: float) -> None:
                said = flight.paused or f"{left:.2f} m to go"
                progress.update(1 - left / whole, said)

            def tell(paused: str) -> None:
                if not quiet:
                    output.note(paused or "went on")

            flight.watch(limit, show, tell)
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


def request_of(x: float, y: float, z: float, *, replace: bool) -> GotoRequest:
    """A request for a point, m; raises Invalid for what is no place."""
    asked = {"x": x, "y": y, "z": z}
    try:
        return msgspec.convert(asked | {"replace": replace}, GotoRequest)
    except msgspec.ValidationError as error:
        axis = str(error).rpartition("$.")[2].rstrip("`")
        raise Invalid(
            f"{axis} = {asked[axis]:g} is no place to fly to",
            "coordinates are metres, finite, and at most 10 km from the origin",
        ) from error
