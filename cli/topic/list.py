"""`topic list`."""

from cli import bus, output
from cli.options import Options


def list_(options: Options) -> None:
    """List the live topics with their type, node and declared rate.

    Example: quadctl topic list
    """
    with bus.connect(options) as client:
        offers = [offer for offer in client.offers() if offer.kind == "@pub"]
    if options.json:
        output.document(
            [
                {"key": o.key, "type": o.type, "node": o.node, "declared_hz": o.hz, "hash": o.hash}
                for o in offers
            ]
        )
        return
    rows = [(o.key, o.type, o.node, f"{o.hz:g} Hz" if o.hz else "on change") for o in offers]
    output.table([("TOPIC", "TYPE", "NODE", "RATE"), *rows])
