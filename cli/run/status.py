"""`status`: the processes of a run."""

import time

from cli import output
from cli.options import Options
from cli.run.rows import duration
from cli.run.usage import memory
from services.runtime import record
from services.runtime.realm import Realm
from services.runtime.record import ProcessRecord
from services.runtime.vehicles import listed


def status(options: Options) -> None:
    """Show the processes of a run.

    Example: quadctl status --json
    """
    run = record.read(Realm(options.realm))
    if options.json:
        output.document(run)
        return
    some = "vehicle" if len(run.vehicles) == 1 else "vehicles"
    output.line(
        f"realm {run.realm}, {some} {listed(run.vehicles)}, supervised by process {run.pid}"
    )
    rows = (_row(node) for node in run.nodes)
    output.table([("NAME", "STATE", "PID", "RESTARTS", "UPTIME", "MEMORY"), *rows])


def _row(node: ProcessRecord) -> tuple[object, ...]:
    taken = memory(node.pid) if node.pid else None
    return (
        node.name,
        node.state,
        node.pid or "-",
        node.restarts,
        duration(time.time() - node.started) if node.pid else "-",
        f"{taken:.0f} MB" if taken is not None else "-",
    )
