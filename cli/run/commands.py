"""`status`, `down` and `init`, which do not import the supervisor itself."""

import time
from pathlib import Path
from typing import Annotated

import msgspec

from quadctl.cli import output
from quadctl.cli.context import Options, require_local
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.output import duration
from quadctl.services.runtime import run_files
from quadctl.services.runtime.errors import Invalid, UsageError
from quadctl.services.runtime.files import write_new
from quadctl.services.runtime.procfs import stats_of
from quadctl.services.runtime.realm import Realm, listed
from quadctl.services.runtime.run_files import ProcessRecord, RunState
from quadctl.services.runtime.supervisor.control import stop_run


def down(options: Options) -> None:
    """Stop the run of a realm and all of its processes.

    Example: quadctl down
    """
    require_local(options, "down")
    run = stop_run(Realm(options.realm), options.timeout)
    document = {"realm": options.realm, "pid": run.pid}
    output.either(options, document, f"realm {options.realm} is down")


DEFAULT_FILE = Path("quad.toml")


def init(
    options: Options,
    file: Annotated[Path | None, Arg("Where to write it (default: ./quad.toml).")] = None,
    safety: Annotated[bool, Option("Write a safety node to begin with: my_safety.py.")] = False,
    mission: Annotated[bool, Option("Write a mission to begin with: mission.toml.")] = False,
) -> None:
    """Write the parameter file with every key, its unit, default and meaning.

    With --safety or --mission, write one of these to begin with instead; with --safety also a
    quad.toml that names it, if there is none.

    Example: quadctl init my_lab.toml
    """
    if safety and mission:
        raise UsageError("--safety does not go with --mission", "write one after the other")
    if safety or mission:
        name = _NODE if safety else _MISSION
        file = file or Path(name)
        write_new(file, _example(name))
    else:
        from quadctl.services.runtime.params.catalogue import render

        file = file or DEFAULT_FILE
        write_new(file, render())
    output.either(options, {"file": str(file)}, f"wrote {file}")
    if safety:
        for line in _named(file):
            if not options.json:
                output.line(line)
    if mission and not options.json:
        output.line(f"`quadctl fly {file}` flies it, with a running system")


_NODE, _MISSION = "my_safety.py", "mission.toml"


def _named(file: Path) -> list[str]:
    """Name a safety node in a new quad.toml; return lines on it, or the TOML for an existing one."""
    import json  # here, because `status` and `down` need none of it
    import shlex

    command = f"python {shlex.quote(file.as_posix())}"
    entry = f"safety = {json.dumps(command, ensure_ascii=False)}"  # a string of TOML, too
    if not DEFAULT_FILE.exists():
        write_new(DEFAULT_FILE, f"[processes]\n{entry}\n")
        return [f"wrote {DEFAULT_FILE}: `quadctl up` runs {file} in place of our own safety"]
    from quadctl.services.runtime.params.load import read

    try:
        processes = read(DEFAULT_FILE).get("processes")
    except Invalid as problem:
        return [f"{DEFAULT_FILE} is left as it was: {problem.message}"]
    if not isinstance(processes, dict):
        return [f"`quadctl up` runs it with these lines at the end of {DEFAULT_FILE}:",
                "[processes]", entry]  # fmt: skip
    if "safety" not in processes:
        return [f"`quadctl up` runs it with this line below [processes] in {DEFAULT_FILE}:", entry]
    if processes["safety"] == command:
        return [f"`quadctl up` runs it: {DEFAULT_FILE} names it"]
    return [f"`quadctl up` runs it with this line in place of safety's in {DEFAULT_FILE}:", entry]


def _example(name: str) -> str:
    """Return the text of an example: in the package, or at the top of a checkout."""
    package = Path(__file__).parents[2]
    folder = next(place for place in (package, package.parents[1]) if (place / "examples").is_dir())
    return (folder / "examples" / name).read_text(encoding="utf-8")


def status(options: Options) -> None:
    """Show the processes of a run.

    Example: quadctl status --json
    """
    require_local(options, "status")
    realm = Realm(options.realm)
    run = run_files.read(realm)
    faults, unproven = _faults(realm, run), _unproven(realm, run)
    if options.json:
        output.document(msgspec.to_builtins(run) | {"faults": faults, "unproven": unproven})
        return
    vehicles = f"vehicle{'s' if len(run.vehicles) > 1 else ''} {listed(run.vehicles)}"
    clock = "in lock-step, " if run.lockstep else ""
    output.line(f"realm {run.realm}, {vehicles}, {clock}supervised by process {run.pid}")
    rows = ((listed(run.vehicles), *_row(node)) for node in run.nodes)
    title = ("VEHICLES", "NAME", "STATE", "PID", "RESTARTS", "UPTIME", "MEMORY")
    output.listing(run.vehicles, [title, *rows])
    for fault in faults:
        vehicle, _, rest = fault.partition(" ")
        named = f" --vehicle {vehicle}" if rest and len(run.vehicles) > 1 else ""
        output.line(f"fault: {fault}; `quadctl fault clear{named}` removes it")
    if unproven:
        output.line(f"warning: no promise holds for {listed(unproven)}: dynamics.unproven")


def _unproven(realm: Realm, run: RunState) -> list[str]:
    """Return the vehicles that may have a body far from those that were flown."""
    tables = ((name, run_files.tables(realm, name)) for name in run.vehicles)
    return [name for name, table in tables if table.get("dynamics", {}).get("unproven")]


def _faults(realm: Realm, run: RunState) -> list[str]:
    """Return the faults that are in, e.g. `uav pose-frozen`; of a process, `safety-frozen`."""
    # Here, because `down` and `init` need none of it.
    from quadctl.cli.fault.catalogue import active
    from quadctl.cli.fault.fault import frozen_of, values_of

    by_vehicle = {name: active(values_of(realm, name)) for name in run.vehicles}
    found = [f"{vehicle} {fault}" for vehicle, faults in by_vehicle.items() for fault in faults]
    return found + frozen_of(run)


def _row(node: ProcessRecord) -> tuple[object, ...]:
    memory = stats_of(node.pid).rss if node.pid else None
    return (
        node.name,
        node.state,
        node.pid or "-",
        node.restarts,
        duration(time.monotonic() - node.began) if node.pid else "-",
        f"{memory / 1e6:.0f} MB" if memory is not None else "-",
    )
