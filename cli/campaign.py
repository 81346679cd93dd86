"""`campaign`: many flights in a separate process, and their report."""

import os
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Self

import msgspec

from quadctl.cli import output
from quadctl.cli.context import Options
from quadctl.cli.declarations import Option
from quadctl.cli.mission.writer import MissionWriter
from quadctl.cli.progress import Progress
from quadctl.services.runtime.errors import (
    Invalid,
    QuadctlError,
    TimedOut,
    Unreachable,
    UsageError,
)
from quadctl.services.runtime.files import refuse_existing
from quadctl.services.runtime.params import load
from quadctl.services.runtime.params.names import flatten

_KINDS = (QuadctlError, UsageError, Unreachable, TimedOut, Invalid)
_COMMAND = (sys.executable, "-P", "-m", "quadctl.services.campaign")
_END = 5.0  # s for the process to end before it is killed


class CampaignProcess:
    """Process of a campaign; it ends with the `with` block."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.report: dict[str, Any] = {}
        # A separate session: only this process gets Ctrl-C. The child ends when its stdin closes.
        self._popen = subprocess.Popen(
            _COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
            # The search's matrices are small: threads of numpy's BLAS would only wait for each other.
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, requested above
        self._popen.stdin.write(msgspec.json.encode(order) + b"\n")
        self._popen.stdin.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._popen.stdin is not None  # noqa: S101 - a pipe, requested above
        assert self._popen.stdout is not None  # noqa: S101 - a pipe, requested above
        self._popen.stdin.close()
        try:
            self._popen.wait(_END)
        except subprocess.TimeoutExpired:
            self._popen.kill()
        self._popen.stdout.close()

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield its progress and notes; raise QuadctlError if it fails."""
        assert self._popen.stdout is not None  # noqa: S101 - a pipe, requested above
        for line in self._popen.stdout:
            if not line.endswith(b"\n"):
                break  # cut off with the process
            message: dict[str, Any] = msgspec.json.decode(line)
            if "error" in message:
                raise _error(*message["error"])
            if "report" in message:
                self.report = message["report"]
                return
            yield message
        raise QuadctlError(
            f"the campaign's process ended with code {self._popen.wait()}", "see the lines above"
        )


def _error(exit_code: int, message: str, hint: str) -> QuadctlError:
    kinds = {kind.exit_code: kind for kind in _KINDS}
    return kinds[exit_code](message, hint)


def lines(report: dict[str, Any], seconds: float, again: str) -> Iterator[str]:
    """Yield the lines of a report; `again` is the command for one of its flights."""
    yield from report.get("log", ())
    worst = report["worst"]
    yield (
        f"{report['flights']} flights of {seconds:g} s, worst excursion beyond the cage "
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
    if near := report.get("separation"):
        yield (
            f"least distance between two vehicles {near['worst']:.2g} m"
            f" (seed {near['seed']}, at {near['at']:.2f} s)"
        )
    for violation in report["violations"]:
        yield f"VIOLATION    seed {violation['seed']}: {'; '.join(violation['what'])}"
        yield f"  again: {again} --replay {violation['seed']}"
    yield f"SHA-256      {report['hash']}"


_LINE_EVERY = 3.0  # s between two lines of progress where there is no terminal
_MOST = 1_000_000  # flights of a campaign: the number of seeds reserved for each
_CROWD = 100  # vehicles of a flight: a job then has five flights
_STRONGEST = 4.0  # m/s of wind: with its gusts about the most that the tilt can hold against
_LONGEST_SEARCH = 86_400  # s
_LARGEST = 2**53  # all JSON readers agree on whole numbers up to this one


def campaign(
    options: Options,
    flights: Annotated[
        int | None, Option("How many flights (default: 1000, in a search no limit).", min=1)
    ] = None,
    seed: Annotated[int, Option("Seed of all random numbers.", min=0)] = 0,
    seconds: Annotated[
        float | None, Option("Simulated seconds of a flight (default: 60, in a search 14).")
    ] = None,
    vehicles: Annotated[int, Option("Vehicles in each flight.", min=1)] = 1,
    faults: Annotated[
        bool, Option("Lose, delay and falsify messages; let vehicle and processes fail.")
    ] = False,
    wind: Annotated[
        float, Option("Mean wind, m/s, in any direction, with gusts of a quarter.")
    ] = 0.0,
    config: Annotated[
        Path | None,
        Option("Fly with the safety and dynamics parameters of this TOML file.", metavar="FILE"),
    ] = None,
    settings: Annotated[
        list[str] | None,
        Option("Fly with this parameter.", ("--set",), "NAME=VALUE", complete="setting"),
    ] = None,
    db: Annotated[
        str,
        Option(
            "Keep the flights in this SQLite file; those in it are not flown again.", metavar="FILE"
        ),
    ] = "",
    report: Annotated[str, Option("Write a report as one HTML page.", metavar="FILE")] = "",
    force: Annotated[bool, Option("Overwrite a report that is there.")] = False,
    search: Annotated[
        int | None, Option("Search for the worst flight for so long.", min=5, metavar="SECONDS")
    ] = None,
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
    flights = flights or (0 if search else 1000)
    seconds = seconds if seconds is not None else 14.0 if search else 60.0
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
    if vehicles > _CROWD:
        raise UsageError(f"--vehicles {vehicles}: too many", f"give at most {_CROWD}")
    given = _given(config, settings or [])
    if wind:
        if any(setting.startswith("dynamics.wind.") for setting in settings or ()):
            raise UsageError("--wind and --set dynamics.wind: two winds", "leave one out")
        given = {
            name: value for name, value in given.items() if not name.startswith("dynamics.wind.")
        }
    if report:
        if not Path(report).absolute().parent.is_dir():
            raise Invalid(f"--report {report}: no such folder", "give a file in an existing folder")
        refuse_existing(Path(report), force=force)
    words = [
        "quadctl",
        "campaign",
        "--seconds",
        f"{seconds:g}",
        *(["--faults"] if faults else []),
    ]
    words += ["--wind", f"{wind:g}"] if wind else []
    words += ["--vehicles", str(vehicles)] if vehicles > 1 else []
    words += ["--config", str(config)] if config else []
    words += [word for setting in settings or () for word in ("--set", setting)]
    command = shlex.join(words)
    order = {
        "flights": flights if replay is None else 1,
        "seed": seed if replay is None else replay,
        "processes": processes or _cores(),
        "conditions": {
            "seconds": seconds,
            "faults": faults,
            "wind": wind,
            "given": given,
            "vehicles": vehicles,
        },
        "db": db,
        "report": report,
        "command": command,
        "dask": dask,
        "insecure": insecure,
        "replay": replay is not None,
        "search": search or 0,
    }
    _check_combination(order)
    if search:
        _search(order, as_json=options.json)
        return
    found = _fly(order, quiet=options.json)
    if options.json:
        output.document(found)
    else:
        for line in lines(found, seconds, command):
            output.line(line)
    output.end(ok=not found["violations"])


def _check_combination(order: dict[str, Any]) -> None:
    """Raise UsageError for options that exclude each other, and for too long a search."""
    shared, replay, search = (
        order["db"] or order["report"] or order["dask"],
        order["replay"],
        order["search"],
    )
    if order["db"] and os.path.realpath(order["db"]) == os.path.realpath(order["report"]):
        raise UsageError("--db and --report are the same file", "give each a file of its own")
    if shared and replay:
        raise UsageError("--replay flies one flight here", "leave out --db, --report and --dask")
    if search and (shared or replay or order["conditions"]["vehicles"] > 1):
        raise UsageError(
            "--search flies one vehicle, on this machine, and keeps only the worst flight",
            "leave out --db, --report, --dask, --replay and --vehicles",
        )
    if search > _LONGEST_SEARCH:
        raise UsageError(f"--search {search}: too long", f"give 5 to {_LONGEST_SEARCH} s, a day")


_UNUSED = ("dynamics.seed", "dynamics.rate", "dynamics.speed")
"""Parameters of the two nodes without an effect on a campaign."""


def _given(config: Path | None, settings: list[str]) -> dict[str, Any]:
    """Return the parameters of the file and the settings, by name; raise Invalid for a wrong one."""
    table, source = load.gather(config, settings)
    checked = dict(flatten(msgspec.to_builtins(load.check(table, source))))

    def used(name: str) -> bool:
        return name.startswith(("safety.", "dynamics.")) and name not in _UNUSED

    for name, _ in flatten(load.gather(None, settings)[0]):
        if not used(name):
            raise UsageError(
                f"--set {name}: no effect on a campaign", "it flies with safety.* and dynamics.*"
            )
    return {name: checked[name] for name, _ in flatten(table) if used(name)}


def _fly(order: dict[str, Any], *, quiet: bool) -> dict[str, Any]:
    began, before = time.monotonic(), 0
    with (
        CampaignProcess(order) as running,
        Progress("flying", quiet=quiet, line_every=0.0 if quiet else _LINE_EVERY) as progress,
    ):
        for message in running:
            if "ready" in message:
                began, before = time.monotonic(), message["ready"]
                if before:
                    output.note(f"{before} of {order['flights']} flights are in {order['db']}")
            elif "flown" in message:
                done, whole = message["flown"], order["flights"]
                rate = (done - before) / (time.monotonic() - began)
                progress.update(
                    done / whole,
                    f"{done} of {whole}, {rate:.0f}/s, worst excursion"
                    f" {1000 * message['worst']:.2g} mm, {(whole - done) / rate:.0f} s left",
                )
            else:
                output.note(message["note"])
        return running.report


def _search(order: dict[str, Any], *, as_json: bool) -> None:
    """Search, and report the worst flight so far also after Ctrl-C; exit 8 if it breaks a promise."""
    file, began, found = MissionWriter(f"worst_{order['seed']}"), time.monotonic(), dict[str, Any]()
    try:
        with (
            CampaignProcess(order) as running,
            Progress(
                "searching", quiet=as_json, line_every=0.0 if as_json else _LINE_EVERY
            ) as progress,
        ):
            for message in running:
                if "ready" in message:
                    began = time.monotonic()
                elif "found" in message:
                    found = message["found"]
                    file.write(found["mission"])
                elif "flown" in message:
                    found["evaluations"] = message["flown"]
                    past = time.monotonic() - began
                    progress.update(
                        past / order["search"],
                        f"{message['flown']} flights, {message['flown'] / past:.0f}/s, worst excursion"
                        f" {1000 * found['worst_excursion']:.2g} mm,"
                        f" {max(order['search'] - past, 0):.0f} s left",
                    )
                else:
                    output.note(message["note"])
            found = running.report
    finally:
        if found:
            found["mission"] = str(file.path)
            output.document({"search": found}) if as_json else output.line(_worst(found))
    output.end(ok=not found["violations"])


def _worst(found: dict[str, Any]) -> str:
    """Return the lines on the worst flight of a search."""
    worst, allowed = 1000 * found["worst_excursion"], 1000 * found["allowed"]
    return "\n".join(
        (
            f"{found['evaluations']} flights, worst excursion beyond the cage {worst:.3g} mm",
            f"at {found['at']:.2f} s; allowed are {allowed:.3g} mm",
            *(f"VIOLATION    {what}" for what in found["violations"]),
            f"again: quadctl fly {shlex.quote(found['mission'])}",
        )
    )


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
