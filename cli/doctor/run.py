"""Checks of a run: supervisor, processes, and its parameters against the file."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from quadctl.cli.doctor.check import Finding, failed, passed, warned
from quadctl.cli.doctor.host import Folder, Neighbours, ProcessFacts
from quadctl.cli.fault.catalogue import active
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.load import load_vehicles
from quadctl.services.runtime.params.names import flatten
from quadctl.services.runtime.realm import listed
from quadctl.services.runtime.run_files import ProcessRecord
from quadctl.services.runtime.supervisor.logs import ABOUT

FILE = Path("quad.toml")
_SHOWN = 5
_ENDED = " ended ("
_LAST_LINES = 5
"""Lines shown of the log of a process that is down."""
_DEFAULTS = "the defaults"


class Settings(NamedTuple):
    """Values of the file here by full dotted name, else the defaults; `error` for a bad file."""

    source: str
    values: dict[str, Any]
    error: Invalid | None = None

    @property
    def is_file(self) -> bool:
        """Return whether there is a file here."""
        return self.source != _DEFAULTS


def settings(vehicle: str, vehicles: Sequence[str], file: Path = FILE) -> Settings:
    """Read the settings of one of a run's vehicles."""
    exists = file.exists()
    source = f"./{file}" if exists else _DEFAULTS
    try:
        params = load_vehicles(file if exists else None, (), vehicles)[vehicle]
    except Invalid as error:
        return Settings(source, {}, error)
    return Settings(source, dict(flatten(msgspec.to_builtins(params))))


def parameter_file(found: Settings) -> Finding:
    """Check that `up` would accept the file here."""
    if found.error is not None:
        return failed("parameter file", found.error.message, found.error.hint)
    if not found.is_file:
        return passed("parameter file", f"no {FILE} here: the defaults hold")
    return passed("parameter file", f"{found.source} is valid")


def parameters(found: Settings, running: Mapping[str, Any]) -> Finding:
    """Check that the running nodes have the values of the file here."""
    if found.error is not None or not running:
        why = "the file is not valid" if found.error else "no node has returned its parameters"
        return warned("parameters", f"not checked: {why}")
    other = [
        f"{name} is {value}, there {found.values[name]}"
        for name, value in sorted(running.items())
        if name in found.values and found.values[name] != value
    ]
    if other:
        more = [f"and {len(other) - _SHOWN} more"] if len(other) > _SHOWN else []
        evidence = "\n".join([f"other than {found.source}:", *other[:_SHOWN], *more])
        load = f", `quadctl param load {FILE}` takes the file's" if found.is_file else ""
        return warned("parameters", evidence, f"`quadctl param save {FILE}` keeps them{load}")
    return passed("parameters", f"{len(running)} values are those of {found.source}")


def faults(running: Mapping[str, Any]) -> Finding:
    """Check that no fault has been put in by name."""
    injected = active(running)
    if injected:
        return warned("faults", f"put in: {', '.join(injected)}", "`quadctl fault clear`")
    return passed("faults", "none is put in")


_PRIVATE = 0o077
_FROZEN = {"T", "t"}


def realm(
    name: str,
    found: Folder,
    others: Neighbours,
    vehicle: str,
    supervisor: ProcessFacts | None = None,
) -> Finding:
    """Check that the realm's folder is private, and that a supervisor that is awake holds it."""
    if found.mode is not None and found.mode & _PRIVATE:
        evidence = f"{found.path} has mode {found.mode:04o}: others can look into it"
        return failed("realm", evidence, f"`chmod 700 {found.path}`")
    if not found.live:
        return _not_live(name, found, others)
    if (run := found.run) is None:
        return warned("realm", f"{name} is just starting", "ask again in a second")
    if found.holder and found.holder != str(run.pid):
        evidence = f"process {found.holder} holds {name}, but its record names process {run.pid}"
        return failed("realm", evidence, f"`kill {found.holder}`, then `quadctl up -d`")
    if supervisor and supervisor.state in _FROZEN:
        evidence = f"the supervisor of {name}, process {run.pid}, is frozen (stopped by a signal)"
        fix = f"`kill -CONT {run.pid}`, or `fg` where it was stopped with Ctrl-Z"
        return failed("realm", evidence, fix)
    if vehicle not in run.vehicles:
        noun = "vehicle" if len(run.vehicles) == 1 else "vehicles"
        evidence = f"{name} runs the {noun} {listed(run.vehicles)}, and {vehicle} was asked for"
        fix = f"`quadctl doctor --vehicle {run.vehicles[0]}`, or `unset QUADCTL_VEHICLE`"
        return failed("realm", evidence, fix)
    if not found.socket:
        evidence = f"{found.path}/hub.sock is gone: no process can reach the hub"
        return failed("realm", evidence, "`quadctl down`, then `quadctl up -d`")
    return passed("realm", f"{name}, supervised by process {run.pid}, in {found.path}")


def _not_live(name: str, found: Folder, others: Neighbours) -> Finding:
    if found.by_hand:
        evidence = f"{name} has no supervisor to restart its processes, which were started by hand"
        return warned("realm", evidence, "end what was started by hand, then `quadctl up -d`")
    if (run := found.run) is not None:
        evidence = f"the run {name} has died: its supervisor, process {run.pid}, left its folder"
        return failed("realm", evidence, "`quadctl up -d`, which takes the folder over")
    evidence, fix = f"nothing is running in {name}", "`quadctl up -d`"
    if others.live:
        evidence += f", but in {', '.join(others.live)}"
        fix += f"; `quadctl doctor --realm {others.live[0]}` looks there"
    return warned("realm", evidence, fix)


def leftovers(others: Neighbours) -> Finding:
    """Check for folders of runs that have died."""
    if not others.dead:
        return passed("leftovers", f"none in {others.root}")
    paths = " ".join(f"{others.root}/{name}" for name in others.dead)
    return warned("leftovers", f"runs that died: {', '.join(others.dead)}", f"`rm -r {paths}`")


def nodes(found: Folder, processes: Mapping[str, ProcessFacts]) -> Iterator[Finding]:
    """Check each process of the run record."""
    for record in found.run.nodes if found.run and found.live else ():
        process = processes.get(record.name, ProcessFacts(""))
        yield node(record, process, found.logs.get(record.name, []))


def node(record: ProcessRecord, process: ProcessFacts, log: Sequence[str]) -> Finding:
    """Check one process: ready, alive, not frozen, not restarted; `log` are the lines of its log."""
    title, name, pid = f"node {record.name}", record.name, record.pid
    if record.state == "down":
        last = "\n".join(log[-_LAST_LINES:])
        evidence = "down: it died again and again" + (f"; its last lines:\n{last}" if last else "")
        return failed(title, evidence, f"`quadctl node logs {name}`, `quadctl node restart {name}`")
    if record.state != "ready":
        return warned(title, record.state, f"ask again in a second; `quadctl node logs {name}`")
    if process.state in {"", "Z", "X"}:
        return failed(title, f"process {pid} has died", f"`quadctl node restart {name}`")
    if process.state in _FROZEN:
        evidence = f"process {pid} is frozen (stopped by a signal)"
        return failed(title, evidence, f"`kill -CONT {pid}`, or `quadctl node restart {name}`")
    if record.restarts:
        times = "once" if record.restarts == 1 else f"{record.restarts} times"
        why = ending(log)
        evidence = f"ready, process {pid}, restarted {times}{f': {why}' if why else ''}"
        return warned(title, evidence, f"`quadctl node logs {name}` shows more")
    return passed(title, f"ready, process {pid}")


def ending(log: Sequence[str]) -> str:
    """Return why a process ended the last time: its last exception, and the supervisor's lines.

    Empty if its log has no such line.
    """
    ends = [number for number, line in enumerate(log) if line.startswith(ABOUT)]
    if not ends:
        return ""
    causes = ends[-1:]
    # Of a process that it kills, the supervisor logs the cause first, then the end.
    if len(ends) > 1 and ends[-2] == ends[-1] - 1 and _ENDED not in log[ends[-2]]:
        causes = ends[-2:]
    before = [number for number in ends if number < causes[0]]
    life = log[before[-1] + 1 if before else 0 : causes[0]]
    traces = [number for number, line in enumerate(life) if line.startswith("Traceback (")]
    after = life[traces[-1] + 1 :] if traces else ()
    raised = next((line for line in after if line and not line[0].isspace()), "")
    return "; ".join(filter(None, (raised, *(log[n].removeprefix(ABOUT) for n in causes))))
