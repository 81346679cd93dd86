"""`campaign`: many flights in a process of its own, and the report of them."""

import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Annotated, Any, Self

import msgspec

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.cli.progress import Progress
from quadctl.services.runtime.errors import QuadctlError, UsageError

_COMMAND = (sys.executable, "-P", "-m", "quadctl.services.campaign")
_END = 5.0


class CampaignProcess:
    """A campaign under way; it ends where this does."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.report: dict[str, Any] = {}
        # In a session of its own: Ctrl-C is ours to hear. It ends when its stdin does.
        self._popen = subprocess.Popen(
            _COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, as asked for above
        self._popen.stdin.write(msgspec.json.encode(order) + b"\n")
        self._popen.stdin.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, as asked for above
        self._popen.stdin.close()
        try:
            self._popen.wait(_END)
        except subprocess.TimeoutExpired:
            self._popen.kill()

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """What it says on the way; raises QuadctlError where it fails."""
        assert self._popen.stdout is not None  # noqa: S101 - a pipe, as asked for above
        for line in self._popen.stdout:
            said: dict[str, Any] = msgspec.json.decode(line)
            if "error" in said:
                raise QuadctlError(**said["error"])
            if "report" in said:
                self.report = said["report"]
                return
            yield said
        raise QuadctlError(
            f"the campaign's process ended with code {self._popen.wait()}", "see the lines above"
        )


def lines(report: dict[str, Any], order: dict[str, Any]) -> Iterator[str]:
    """The report of an order, a line at a time."""
    yield from report.get("log", ())
    worst = report["worst"]
    yield (
        f"{report['flights']} flights of {order['seconds']:g} s, worst excursion beyond the cage "
        f"{report['worst_excursion']:.2g} m (seed {worst['seed']}, at {worst['at']:.2f} s)"
    )
    for name in ("transitions", "refusals", "stops"):
        for what, count in report[name].items():
            yield f"{name:12} {count:8}  {what}"
    arrivals = report["arrivals"]
    if arrivals["count"]:
        parts = ("median", "p90", "p99", "most")
        yield f"{'arrivals':12} {arrivals['count']:8}  in " + ", ".join(
            f"{arrivals[part]:.2f} s ({part})" for part in parts
        )
    more = (" --faults" if order["faults"] else "") + (
        f" --wind {order['wind']:g}" if order["wind"] else ""
    )
    for violation in report["violations"]:
        yield f"VIOLATION    seed {violation['seed']}: {'; '.join(violation['what'])}"
        yield f"  again: quadctl campaign --replay {violation['seed']} --seconds {order['seconds']:g}{more}"
    yield f"SHA-256      {report['hash']}"


_MOST = 1_000_000
"""Flights: as many seeds as a campaign has to itself."""
_STRONGEST = 6.0
"""Wind (m/s): with its gusts, about what the tilt of the vehicle can hold against."""
_LARGEST = 2**53
"""Where JSON's readers stop to agree on whole numbers."""


def campaign(
    options: Options,
    flights: Annotated[int, Option("How many flights.", min=1)] = 1000,
    seed: Annotated[int, Option("Of all random numbers.", min=0)] = 0,
    seconds: Annotated[float, Option("Simulated seconds of a flight.")] = 60.0,
    faults: Annotated[bool, Option("Poses and setpoints get lost, late and false.")] = False,
    wind: Annotated[float, Option("Mean wind, m/s, from anywhere, with gusts of a quarter.")] = 0.0,
    replay: Annotated[
        int | None, Option("Fly the flight of this seed again, with its log.", min=0)
    ] = None,
    processes: Annotated[
        int | None, Option("How many to share the work (default: all cores).", min=1)
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
    output.end(ok=not report["violations"])


def _fly(order: dict[str, Any], *, quiet: bool) -> dict[str, Any]:
    with CampaignProcess(order) as running, Progress("flying", quiet=quiet) as progress:
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
