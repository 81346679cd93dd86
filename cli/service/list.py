"""`service list`."""

from cli import bus, output
from cli.options import Options


def list_(options: Options) -> None:
    """List the live services with their type and node.

    Example: quadctl service list
    """
    with bus.connect(options) as client:
        offers = [offer for offer in client.offers() if offer.kind == "@srv"]
    if options.json:
        output.document(
            [{"name": o.name, "key": o.key, "type": o.type, "node": o.node} for o in offers]
        )
        return
    output.table([("SERVICE", "TYPE", "NODE"), *((o.name, o.type, o.node) for o in offers)])
