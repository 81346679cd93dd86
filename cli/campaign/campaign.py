"""`campaign`: random flights by the thousand, scored against what safety promises."""

import os
import sys
from typing import Annotated, Any

from cli import output
from cli.campaign.process import Running
from cli.campaign.told import lines
from cli.declare import Opt
from cli.lab.progress import Progress
from cli.options import Options
from services.runtime.errors import UsageError

_FAULT_FOUND = 8
_MOST = 1_000_000
"""Flights: as many seeds as a campaign has to itself."""
_STRONGEST = 6.0
"""Wind (m/s): with its gusts, about what the tilt of the vehicle can hold against."""
_LARGEST = 2**53
"""Where JSON's readers stop to agree on whole numbers."""


def campaign(
    options: Options,
    flights: Annotated[int, Opt("How many flights.", min=1)] = 1000,
    seed: Annotated[int, Opt("Of all random numbers.", min=0)] = 0,
    seconds: Annotated[float, Opt("Simulated seconds of a flight.")] = 60.0,
    faults: Annotated[bool, Opt("Poses and setpoints get lost, late and false.")] = False,
    wind: Annotated[float, Opt("Mean wind, m/s, from anywhere, with gusts of a quarter.")] = 0.0,
    replay: Annotated[
        int | None, Opt("Fly the flight of this seed again, with its log.", min=0)
    ] = None,
    processes: Annotated[
        int | None, Opt("How many to share the work (default: all cores).", min=1)
    ] = None,
) -> None:
    """Fly random missions faster than real time; exit 8 where one breaks a promise.

    They fly on the automaton and the dynamics of the live system, which need not be up.

    Example: quadctl campaign --flights 10000 --seed 1
    """
    if not 0.05 <= seconds <= 3600:
        raise UsageError(f"--seconds {seconds:g}: no length of a flight", "from 0.05 to 3600")
    if not 0 <= wind <= _STRONGEST:
        raise UsageError(f"--wind {wind:g}: no wind to fly in", f"from 0 to {_STRONGEST:g} m/s")
    if flights > _MOST or max(seed * _MOST, replay or 0) > _LARGEST:
        raise UsageError(
            f"--flights {flights}, --seed {seed}: too many",
            f"at most {_MOST} flights, and seeds up to {_LARGEST // _MOST}",
        )
    order = {
        "flights": flights if replay is None else 1,
        "seed": seed if replay is None else replay,
        "seconds": seconds,
        "faults": faults,
        "wind": wind,
        "processes": processes or _cores(),
        "replay": replay is not None,
    }
    report = _fly(order, quiet=options.json)
    if options.json:
        output.document(report)
    else:
        for line in lines(report, order):
            output.line(line)
    if report["violations"]:
        sys.exit(_FAULT_FOUND)


def _fly(order: dict[str, Any], *, quiet: bool) -> dict[str, Any]:
    with Running(order) as running, Progress("flying", quiet=quiet) as progress:
        for said in running:
            if "flown" in said:
                done = said["flown"]
                progress.update(done / order["flights"], f"{done} of {order['flights']}")
            elif "note" in said:
                output.note(said["note"])
        return running.report


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
