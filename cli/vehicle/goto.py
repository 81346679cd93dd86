"""`goto`: one flight, followed to its end."""

import math
from typing import Annotated, Any

from quadctl.cli import context, output
from quadctl.cli.context import LONGEST_TIMEOUT, Options
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.progress import Progress
from quadctl.services.runtime.errors import Invalid, QuadctlError, UsageError
from quadctl.vehicle import Flight, goal_of


def goto(
    options: Options,
    x: Annotated[float, Arg("East, m.")],
    y: Annotated[float, Arg("North, m.")],
    z: Annotated[float, Arg("Up, m.")],
    no_wait: Annotated[bool, Option("Return with safety's verdict.")] = False,
    replace: Annotated[bool, Option("Change course while flying to another goal.")] = False,
    direct: Annotated[bool, Option("Refuse rather than fly around zones.")] = False,
    wait: Annotated[bool, Option("Wait for vehicles that fly too near the way.")] = False,
    settle: Annotated[bool, Option("Wait until the vehicle rests at its goal.")] = False,
    arrive: Annotated[
        float | None, Option("Seconds to arrive in (default: twice the planned time and 5).")
    ] = None,
) -> None:
    """Fly to a point, if safety permits, and wait for the arrival.

    Where zones bar the straight way, the vehicle flies around them. A goal too near another
    vehicle's way is refused, or with --wait waits until that vehicle has passed.

    Example: quadctl goto 1 -2 1.5
    """
    check_arrive(arrive)
    if settle and no_wait:
        raise UsageError("--settle goes not with --no-wait", "leave one of them out")
    request = goal_of(x, y, z, replace=replace, direct=direct, wait=wait)
    as_json = options.json
    with context.connect(options) as client:
        flight = Flight(client, request)
        if not as_json:
            output.line("accepted" if flight.accepted else "rejected")
            if no_wait and flight.paused:
                output.note(flight.paused)
        problem: QuadctlError | None = None
        if not flight.accepted:
            problem = flight.refusal()
        elif not no_wait:
            problem = _watch(flight, arrive, settle=settle, quiet=as_json)
    if as_json:
        output.document(report(flight, followed=not no_wait))
    elif not no_wait and flight.arrived:
        how = "rests" if settle and problem is None else "arrived"
        output.line(f"{how} within {flight.distance:.2f} m after {flight.seconds:.2f} s")
    if problem is not None:
        raise problem


def check_arrive(arrive: float | None) -> None:
    """Raise Invalid unless this is a time (s) to arrive in."""
    if arrive is not None and not 0 < arrive <= LONGEST_TIMEOUT:
        raise Invalid(f"--arrive {arrive}: not a time", "give seconds, more than 0")


def _watch(
    flight: Flight, arrive: float | None, *, settle: bool, quiet: bool
) -> QuadctlError | None:
    """Show the flight until it ends; return the error that kept it from its goal."""
    try:
        whole = max(flight.begin(), 1e-6)
        with Progress("flying", quiet=quiet) as progress:

            def show(left: float) -> None:
                progress.update(1 - left / whole, flight.paused or f"{left:.2f} m to go")

            def show_pause(paused: str) -> None:
                if not quiet:
                    output.note(paused or "went on")

            flight.wait(arrive, show, show_pause)
        if settle:
            flight.settle()
    except QuadctlError as problem:
        return problem
    except KeyboardInterrupt:
        output.note(f"stopped waiting: {flight.goes_on()}")
        raise
    return None


def report(flight: Flight | None, *, followed: bool) -> dict[str, Any]:
    """Return the --json document of a flight, which is None without an answer."""
    known = followed and flight is not None and math.isfinite(flight.distance)
    return {
        "accepted": flight is not None and flight.accepted,
        "reason": flight.reason if flight else "",
        "arrived": followed and flight is not None and flight.arrived,
        "distance": flight.distance if flight and known else None,
        "seconds": flight.seconds if flight and known else None,
    }
