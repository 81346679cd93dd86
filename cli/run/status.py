"""`status`: the processes of a run."""

from cli import output
from cli.options import Options
from services.runtime import record
from services.runtime.realm import Realm


def status(options: Options) -> None:
    """Show the processes of a run.

    Example: quadctl status --json
    """
    run = record.read(Realm(options.realm))
    if options.json:
        output.document(run)
        return
    output.line(f"realm {run.realm}, vehicle {run.vehicle}, supervised by process {run.pid}")
    rows = [(node.name, node.state, node.pid or "-", node.restarts) for node in run.nodes]
    output.table([("NAME", "STATE", "PID", "RESTARTS"), *rows])
