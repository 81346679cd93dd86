"""`node list`."""

import msgspec

from cli import bus, output
from cli.options import Options
from services.runtime import record
from services.runtime.errors import Unreachable
from services.runtime.realm import Realm


def list_(options: Options) -> None:
    """List the nodes: those that `up` looks after, and any other that has announced itself.

    Example: quadctl node list
    """
    try:
        nodes = msgspec.to_builtins(record.read(Realm(options.realm)).nodes)
    except Unreachable:
        if not options.connect:
            raise
        nodes = []
    try:
        with bus.connect(options) as client:
            live, offers = client.nodes(), client.offers()
    except Unreachable:
        # The supervisor still knows what runs while its hub is being restarted.
        live, offers = [], []
    known = {node["name"] for node in nodes}
    strangers = [name for name in live if name not in known]
    nodes += [{"name": name, "pid": 0, "state": "ready", "restarts": 0} for name in strangers]
    for node in nodes:
        for kind, title in (("@pub", "topics"), ("@srv", "services")):
            mine = (offer for offer in offers if offer.node == node["name"] and offer.kind == kind)
            node[title] = [offer.key for offer in mine]
    if options.json:
        output.document(nodes)
        return
    rows = [
        (node["name"], node["state"], node["pid"] or "-", node["restarts"],
         len(node["topics"]), len(node["services"]))
        for node in nodes
    ]  # fmt: skip
    output.table([("NAME", "STATE", "PID", "RESTARTS", "TOPICS", "SERVICES"), *rows])
