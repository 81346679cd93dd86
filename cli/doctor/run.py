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

FILE = Path("quad.toml")
_SHOWN = 5
_DEFAULTS = "the defaults"


class Settings(NamedTuple):
    """What the file here says by full dotted names, else the defaults; `error` where it cannot be."""

    source: str
    values: dict[str, Any]
    error: Invalid | None = None

    @property
    def is_file(self) -> bool:
        """Whether there is a file here."""
        return self.source != _DEFAULTS


def settings(vehicle: str, vehicles: Sequence[str], file: Path = FILE) -> Settings:
    """Read those of one of a run's vehicles."""
    there = file.exists()
    source = f"./{file}" if there else _DEFAULTS
    try:
        params = load_vehicles(file if there else None, (), vehicles)[vehicle]
    except Invalid as error:
        return Settings(source, {}, error)
    return Settings(source, dict(flatten(msgspec.to_builtins(params))))


def parameter_file(found: Settings) -> Finding:
    """The file here is one that `up` would take."""
    if found.error is not None:
        return failed("parameter file", found.error.message, found.error.hint)
    if not found.is_file:
        return passed("parameter file", f"no {FILE} here: the defaults hold")
    return passed("parameter file", f"{found.source} is valid")


def parameters(found: Settings, running: Mapping[str, Any]) -> Finding:
    """The running nodes have the values of the file here."""
    if found.error is not None or not running:
        why = "the file is not valid" if found.error else "no node has told its parameters"
        return warned("parameters", f"not checked: {why}")
    other = [
        f"{name} is {value}, there {found.values[name]}"
        for name, value in sorted(running.items())
        if name in found.values and found.values[name] != value
    ]
    if other:
        more = [f"and {len(other) - _SHOWN} more"] if len(other) > _SHOWN else []
        return warned(
            "parameters",
            "\n".join([f"other than {found.source}:", *other[:_SHOWN], *more]),
            f"`quadctl param save {FILE}` keeps them"
            + (f", `quadctl param load {FILE}` takes the file's" if found.is_file else ""),
        )
    return passed("parameters", f"{len(running)} values are those of {found.source}")


def faults(running: Mapping[str, Any]) -> Finding:
    """No fault has been put in by name."""
    there = active(running)
    if there:
        return warned("faults", f"put in: {', '.join(there)}", "`quadctl fault clear`")
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
    """The realm's folder is private, and a supervisor that is awake holds it."""
    if not found.owned:
        return failed(
            "realm",
            f"{found.path} belongs to another user",
            "set XDG_RUNTIME_DIR to a folder of your own",
        )
    if found.mode is not None and found.mode & _PRIVATE:
        return failed(
            "realm",
            f"{found.path} has mode {found.mode:04o}: others can look into it",
            f"`chmod 700 {found.path}`",
        )
    if not found.live:
        return _not_live(name, found, others)
    if found.run is None:
        return warned("realm", f"{name} is just starting", "ask again in a second")
    if found.holder and found.holder != str(found.run.pid):
        return failed(
            "realm",
            f"process {found.holder} holds {name}, and its record names process {found.run.pid}",
            f"`kill {found.holder}`, then `quadctl up -d`",
        )
    if supervisor and supervisor.state in _FROZEN:
        return failed(
            "realm",
            f"the supervisor of {name}, process {found.run.pid}, is frozen (stopped by a signal)",
            f"`kill -CONT {found.run.pid}`, or `fg` where it was stopped with Ctrl-Z",
        )
    if vehicle not in found.run.vehicles:
        there = listed(found.run.vehicles)
        return failed(
            "realm",
            f"{name} runs the vehicle {there}, and {vehicle} was asked for",
            f"`quadctl doctor --vehicle {found.run.vehicles[0]}`, or `unset QUADCTL_VEHICLE`",
        )
    if not found.socket:
        return failed(
            "realm",
            f"{found.path}/hub.sock is gone: nobody can reach the hub",
            "`quadctl down`, then `quadctl up -d`",
        )
    return passed("realm", f"{name}, supervised by process {found.run.pid}, in {found.path}")


def _not_live(name: str, found: Folder, others: Neighbours) -> Finding:
    if found.by_hand:
        return warned(
            "realm",
            f"{name} has no supervisor: what runs was started by hand, and nobody restarts it",
            "`quadctl up -d`, after ending what was started by hand",
        )
    if found.run is not None:
        return failed(
            "realm",
            f"the run of {name} has died: its supervisor, process {found.run.pid}, left its folder",
            "`quadctl up -d`, which takes the folder over",
        )
    said, fix = f"nothing is running in {name}", "`quadctl up -d`"
    if others.live:
        said += f", but in {', '.join(others.live)}"
        fix += f"; `quadctl doctor --realm {others.live[0]}` looks there"
    return warned("realm", said, fix)


def leftovers(others: Neighbours) -> Finding:
    """Folders that runs have left which died."""
    if not others.dead:
        return passed("leftovers", f"none in {others.root}")
    paths = " ".join(f"{others.root}/{name}" for name in others.dead)
    return warned("leftovers", f"runs that died: {', '.join(others.dead)}", f"`rm -r {paths}`")


def nodes(found: Folder, processes: Mapping[str, ProcessFacts]) -> Iterator[Finding]:
    """Each process of the run record."""
    for record in found.run.nodes if found.run and found.live else ():
        yield node(
            record, processes.get(record.name, ProcessFacts("")), found.last.get(record.name, "")
        )


def node(record: ProcessRecord, process: ProcessFacts, last: str) -> Finding:
    """One process: ready, alive, not frozen, not restarted."""
    title, name, pid = f"node {record.name}", record.name, record.pid
    if record.state == "down":
        said = f"; it said last:\n{last}" if last else ""
        return failed(
            title,
            f"down: it died again and again{said}",
            f"`quadctl node logs {name}`, `quadctl node restart {name}`",
        )
    if record.state != "ready":
        return warned(title, record.state, f"ask again in a second; `quadctl node logs {name}`")
    if process.state in {"", "Z", "X"}:
        return failed(title, f"process {pid} has died", f"`quadctl node restart {name}`")
    if process.state in _FROZEN:
        return failed(
            title,
            f"process {pid} is frozen (stopped by a signal)",
            f"`kill -CONT {pid}`, or `quadctl node restart {name}`",
        )
    if record.restarts:
        times = "once" if record.restarts == 1 else f"{record.restarts} times"
        return warned(
            title,
            f"ready, process {pid}, restarted {times}",
            f"`quadctl node logs {name}` says why",
        )
    return passed(title, f"ready, process {pid}")
