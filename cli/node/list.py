"""`node list`."""

import msgspec

from cli import output
from cli.node.seen import connected, run_of, see
from cli.options import Options
from services.runtime.errors import QuadctlError


def list_(options: Options) -> None:
    """List the nodes: those that `up` looks after, and any other that has announced itself.

    Example: quadctl node list
    """
    run = run_of(options)
    client = connected(options, run)
    if isinstance(client, QuadctlError):
        output.note(f"what is on the bus cannot be seen: {client.message}")
        seen = see(None, run)
    else:
        with client:
            seen = see(client, run)
    nodes = [
        msgspec.to_builtins(process)
        | {
            title: [offer.key for offer in seen.offered(process.name, kind)]
            for title, kind in (("topics", "@pub"), ("services", "@srv"))
        }
        for process in seen.processes
    ]
    if options.json:
        output.document(nodes)
        return
    rows = [
        (node["name"], node["state"], node["pid"] or "-", node["restarts"],
         len(node["topics"]), len(node["services"]))
        for node in nodes
    ]  # fmt: skip
    output.table([("NAME", "STATE", "PID", "RESTARTS", "TOPICS", "SERVICES"), *rows])
