"""`up`, `down`, `status`, `init`: the run as a whole."""

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from cli import options, output

_DEFAULT_FILE = Path("quad.toml")

File = Annotated[
    Path | None, typer.Argument(help="Parameter file (default: ./quad.toml if it is there).")
]


def up(
    ctx: typer.Context,
    file: File = None,
    detach: Annotated[
        bool, typer.Option("--detach", "-d", help="Return when all processes are ready.")
    ] = False,
    without: Annotated[
        list[str] | None, typer.Option(metavar="NODE", help="Leave a process out.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Override a parameter of the file."),
    ] = None,
) -> None:
    """Start hub, dynamics, pressure and safety; Ctrl-C stops them.

    Example: quadctl up -d --set safety.virtual_cage.x=3
    """
    from services.runtime import up as running
    from services.runtime.detach import detach as in_background
    from services.runtime.launch import Launch
    from services.runtime.params import load

    chosen = options.of(ctx)
    source = file or (_DEFAULT_FILE if _DEFAULT_FILE.exists() else None)
    params = load(source, settings or ())
    folder = source.resolve().parent if source else Path.cwd()
    launch = Launch(chosen.realm, chosen.vehicle, params, without or [], str(folder))
    launch.processes()
    if detach:
        in_background(launch)
        if chosen.json:
            status(ctx)
        else:
            output.line(f"realm {chosen.realm} is up")
        return
    # Lines are the only output of a run in the foreground, so --json changes nothing there.
    number = running.run(launch, sys.stdout, lambda _supervisor, _failed: None)
    if number == signal.SIGINT:
        raise typer.Exit(128 + number)


def down(ctx: typer.Context) -> None:
    """Stop the run of a realm and all of its processes.

    Example: quadctl down
    """
    from services.runtime import record
    from services.runtime.realm import Realm

    chosen = options.of(ctx)
    realm = Realm(chosen.realm)
    run = record.stop(realm)
    if chosen.json:
        output.document({"realm": realm.name, "pid": run.pid})
    else:
        output.line(f"realm {realm.name} is down")


def status(ctx: typer.Context) -> None:
    """Show the processes of a run.

    Example: quadctl status --json
    """
    from services.runtime import record
    from services.runtime.realm import Realm

    chosen = options.of(ctx)
    run = record.read(Realm(chosen.realm))
    if chosen.json:
        output.document(run)
        return
    output.line(f"realm {run.realm}, vehicle {run.vehicle}, supervised by process {run.pid}")
    rows = [(node.name, node.state, node.pid or "-", node.restarts) for node in run.nodes]
    output.table([("NAME", "STATE", "PID", "RESTARTS"), *rows])
