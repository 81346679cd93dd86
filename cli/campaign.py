"""`campaign`: many flights in a separate process, and their report."""

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
from quadctl.services.runtime.errors import (
    NotAllowed,
    QuadctlError,
    TimedOut,
    Unreachable,
    UsageError,
)

_COMMAND = (sys.executable, "-P", "-m", "quadctl.services.campaign")
_ERRORS = {
    error.code: error for error in (QuadctlError, UsageError, Unreachable, NotAllowed, TimedOut)
}
_END = 5.0  # s for the process to end before it is killed


class CampaignProcess:
    """Process of a campaign; it ends with the `with` block."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.report: dict[str, Any] = {}
        # A separate session: only this process gets Ctrl-C. The child ends when its stdin closes.
        self._popen = subprocess.Popen(
            _COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, requested above
        self._popen.stdin.write(msgspec.json.encode(order) + b"\n")
        self._popen.stdin.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, requested above
        self._popen.stdin.close()
        try:
            self._popen.wait(_END)
        except subprocess.TimeoutExpired:
            self._popen.kill()

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield its progress and notes; raise QuadctlError if it fails."""
        assert self._popen.stdout is not None  # noqa: S101 - a pipe, requested above
        for line in self._popen.stdout:
            message: dict[str, Any] = msgspec.json.decode(line)
            if "error" in message:
                code, *said = message["error"].values()
                raise _ERRORS[code](*said)
            if "report" in message:
                self.report = message["report"]
                return
            yield message
        raise QuadctlError(
            f"the campaign's process ended with code {self._popen.wait()}", "see the lines above"
        )


def lines(report: dict[str, Any], order: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of the report of an order."""
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


_MOST = 1_000_000  # flights of a campaign: the number of seeds reserved for each
_STRONGEST = 6.0  # m/s of wind: with its gusts about the most that the tilt can hold against
_LARGEST = 2**53  # all JSON readers agree on whole numbers up to this one


def campaign(
    options: Options,
    flights: Annotated[int, Option("How many flights.", min=1)] = 1000,
    seed: Annotated[int, Option("Seed of all random numbers.", min=0)] = 0,
    seconds: Annotated[float, Option("Simulated seconds of a flight.")] = 60.0,
    faults: Annotated[bool, Option("Lose, delay and falsify poses and setpoints.")] = False,
    wind: Annotated[
        float, Option("Mean wind, m/s, in any direction, with gusts of a quarter.")
    ] = 0.0,
    replay: Annotated[
        int | None, Option("Fly the flight of this seed again, with its log.", min=0)
    ] = None,
    processes: Annotated[
        int | None, Option("Number of processes (default: one per core).", min=1)
    ] = None,
    dask: Annotated[
        str, Option("Fly on the workers of this Dask scheduler, or local.", metavar="ADDRESS")
    ] = "",
    insecure: Annotated[bool, Option("Allow a scheduler without encryption on a network.")] = False,
) -> None:
    """Fly random missions faster than real time; exit 8 if one breaks a promise.

    They use the automaton and the dynamics of the live system, which need not be up.

    Example: quadctl campaign --flights 10000 --seed 1
    """
    if not 0.05 <= seconds <= 3600:
        raise UsageError(f"--seconds {seconds:g}: not a possible length", "give 0.05 to 3600 s")
    if not 0 <= wind <= _STRONGEST:
        raise UsageError(
            f"--wind {wind:g}: too strong or negative", f"give 0 to {_STRONGEST:g} m/s"
        )
    if flights > _MOST or max(seed * _MOST, replay or 0) > _LARGEST:
        raise UsageError(
            f"--flights {flights}, --seed {seed}: too large",
            f"give at most {_MOST} flights, and a seed up to {_LARGEST // _MOST}",
        )
    order = {
        "flights": flights if replay is None else 1,
        "seed": seed if replay is None else replay,
        "seconds": seconds,
        "faults": faults,
        "wind": wind,
        "processes": processes or _cores(),
        "replay": replay is not None,
        "dask": dask,
        "insecure": insecure,
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
        for message in running:
            if "flown" in message:
                done = message["flown"]
                progress.update(done / order["flights"], f"{done} of {order['flights']}")
            elif "note" in message:
                output.note(message["note"])
        return running.report


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
