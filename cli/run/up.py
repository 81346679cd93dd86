"""`up` and `hub`: the start of a run."""

import json
import os
import shlex
import signal
import sys
from pathlib import Path
from typing import Annotated

from msgspec import structs

from quadctl.cli import output
from quadctl.cli.bridge.process import require
from quadctl.cli.context import Options
from quadctl.cli.declarations import Arg, Option
from quadctl.cli.run.background_writer import BackgroundWriter
from quadctl.cli.run.commands import DEFAULT_FILE, status
from quadctl.cli.run.screen import Screen, has_colour, is_live
from quadctl.services.airspace.airworthiness import limited
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.params import load
from quadctl.services.runtime.process_table import NODES, Process
from quadctl.services.runtime.realm import DEFAULT, HUB_ALONE
from quadctl.services.runtime.supervisor import capacity, supervisor as running
from quadctl.services.runtime.supervisor.daemon import start_in_background as in_background
from quadctl.services.runtime.supervisor.launch import Launch
from quadctl.services.runtime.supervisor.logs import Printer
from quadctl.services.runtime.supervisor.supervisor import Supervisor

Detach = Annotated[bool, Option("Return when all processes are ready.", ("--detach", "-d"))]
Listen = Annotated[
    list[str] | None, Option("Listen on the network, e.g. tls/0.0.0.0:7447.", metavar="ENDPOINT")
]
Insecure = Annotated[bool, Option("Let other machines reach listeners without encryption.")]


def up(
    options: Options,
    file: Annotated[Path | None, Arg("Parameter file (default: ./quad.toml if any).")] = None,
    detach: Detach = False,
    vehicles: Annotated[
        int | None, Option("Number of vehicles: uav0, uav1 .. (default: one, uav).", metavar="N")
    ] = None,
    without: Annotated[list[str] | None, Option("Leave a process out.", metavar="NODE")] = None,
    settings: Annotated[
        list[str] | None,
        Option("Override a parameter of the file.", ("--set",), "NAME=VALUE", complete="setting"),
    ] = None,
    listen: Listen = None,
    insecure: Insecure = False,
    record: Annotated[
        str | None,
        Option(
            "Record the run (default: quadctl_DATE_TIME.mcap).",
            metavar="[FILE.mcap]",
            ending=".mcap",
        ),
    ] = None,
    bridge: Annotated[
        list[str] | None,
        Option("Start a bridge to another network: foxglove, mavlink or ros2.", metavar="NAME"),
    ] = None,
) -> None:
    """Start hub, dynamics, pressure and safety; Ctrl-C stops them.

    Several vehicles start on a grid of 2 m; --set uav3.safety.takeoff=2 sets a parameter of one.
    With --connect the run's hub joins another hub.

    Example: quadctl up -d --set safety.virtual_cage.x=3
    """
    if file is not None and ":=" in file.name:
        name, _, value = str(file).partition(":=")
        ours = f"`quadctl up --set {_parameter(name)}={value}`"
        raise UsageError(f"{file} is the form of a launch file's argument", ours)
    source = file or (DEFAULT_FILE if DEFAULT_FILE.exists() else None)
    stem = options.named or DEFAULT
    names = [stem] if vehicles is None else load.names(stem, vehicles)
    network = hub_settings(listen, options.connect)
    parameters = load.load_vehicles(source, [*(settings or ()), *network], names)
    folder = source.resolve().parent if source else Path.cwd()
    recording = "" if record is None else _recording(record)
    bridges = tuple(dict.fromkeys(bridge or ()))
    for each in bridges:
        require(each)
    launch = Launch(
        options.realm, parameters, without or [], str(folder), recording, insecure, bridges=bridges
    )
    own = [each for each in launch.processes() if each.stranger]
    if not detach:
        _name(own)
    begin(launch, options, detach=detach)
    if detach:  # only now: with --json an error is all that stderr holds
        _name(own)
    bodies = (each.dynamics for each in parameters.values() if detach)
    limits = (line for each in bodies for line in limited(each.vehicle, each.control, each.wind))
    for line in dict.fromkeys(limits):
        output.note(line)


def _name(own: list[Process]) -> None:
    """Print the commands that run in place of our nodes or beside them: a forgotten file shows."""
    for process in own:
        command = " ".join(shlex.join(process.command).split())  # on one line
        output.note(f"{process.name}: {command}")


def _parameter(name: str) -> str:
    """Return the full name of the only parameter with this last part, else the name itself."""
    from quadctl.services.runtime.params.catalogue import leaves

    named = [leaf for leaf in leaves() if leaf.rpartition(".")[2] == name]
    return named[0] if len(named) == 1 else name


def hub_settings(listen: list[str] | None, connect: str) -> list[str]:
    """Return the settings for the hub's listeners and for the other hub that it joins."""
    endpoints = {"listen": listen or [], "connect": [connect] if connect else []}
    return [f"hub.{name}={json.dumps(places)}" for name, places in endpoints.items() if places]


def begin(launch: Launch, options: Options, *, detach: bool) -> None:
    """Supervise a run, here or in the background."""
    launch.processes()
    capacity.check(launch)
    options = structs.replace(options, connect="")
    if detach:
        in_background(launch, output.note)
        if options.json:
            status(options)
        else:
            output.line(f"realm {options.realm} is up")
        return
    if _watch(launch) == signal.SIGINT:
        sys.exit(128 + signal.SIGINT)


def _recording(name: str) -> str:
    """Return the recording's absolute path: the recorder works in another folder."""
    from quadctl.cli.record.record import default_file, free

    file = Path(name) if name else default_file()
    free(file)
    return str(file.resolve())


def _watch(launch: Launch) -> int:
    """Run in the foreground and return the signal that ended the run.

    It prints only lines, so --json changes nothing; a terminal shows the processes below them.
    """
    if not is_live():
        with BackgroundWriter(sys.stdout) as writer:
            emit = Printer(writer.write, colour=has_colour())
            return running.run(launch, emit, _go_on, lambda _: writer.check())
    with Screen(launch) as screen:
        return running.run(launch, screen.emit, _go_on, screen.look)


def _go_on(_supervisor: Supervisor, _failed: str) -> None:
    """Continue: a process that is left down does not end the others."""


def hub(
    options: Options, detach: Detach = False, listen: Listen = None, insecure: Insecure = False
) -> None:
    """Run a hub without a vehicle, for other hubs to join; with --connect it joins another hub.

    Example: quadctl hub --listen tls/0.0.0.0:7447 --identity keys/field
    """
    # The keys of a hub's nodes begin with its name, which two hubs must not share.
    name = options.named or f"{HUB_ALONE}{os.urandom(2).hex()}"
    parameters = load.load_vehicles(None, hub_settings(listen, options.connect), [name])
    without = [node for node in NODES if node != "hub"]
    launch = Launch(options.realm, parameters, without, str(Path.cwd()), insecure=insecure)
    begin(launch, options, detach=detach)
