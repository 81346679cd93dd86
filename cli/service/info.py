"""`service list` and `service info`."""

from typing import Annotated

from quadctl.cli import context, output
from quadctl.cli.context import Options, about_service
from quadctl.cli.declarations import Arg
from quadctl.cli.service import call
from quadctl.schemas.typeinfo import service_definition
from quadctl.services.runtime.errors import Unreachable


def list_(options: Options) -> None:
    """List the live services with their type and node.

    Example: quadctl service list
    """
    with context.connect(options) as client:
        offers = call.services(client)
    if options.json:
        output.document(
            [{"name": o.name, "key": o.key, "type": o.type, "node": o.node} for o in offers]
        )
        return
    output.table([("SERVICE", "TYPE", "NODE"), *((o.name, o.type, o.node) for o in offers)])


def info(options: Options, name: Annotated[str, Arg("A service.", complete="service")]) -> None:
    """Show a service's node, key, type and fields; of one of your own, what it tells on the bus.

    Example: quadctl service info calibrate_pressure
    """
    options = about_service(options, name)
    ours = call.declared(name, options.vehicle)
    with call.connect(options, name) as client:
        offer = call.offered(client, ours.key(client.vehicle) if ours else name)
        if offer is None and ours is None:
            raise call.unknown(client, name)
        if offer is None:
            assert ours is not None  # noqa: S101 - or else it was unknown
            nobody = Unreachable(
                f"nobody serves {ours.key(options.vehicle)} now",
                f"is {ours.node} up? `quadctl status` shows it",
            )
            raise client.explained(nobody, ours.node)
    said = {"name": offer.name, "key": offer.key, "type": offer.type, "node": offer.node}
    fields = service_definition(ours.request, ours.response) if ours else ""
    if options.json:
        output.document(said | {"hash": offer.hash, "definition": fields})
        return
    about = ours.doc if ours else "none of quadctl's own: its node's author knows its fields"
    rows = (("Node", offer.node), ("Key", offer.key), ("Type", offer.type), ("About", about))
    output.table((f"{title}:", text) for title, text in rows)
    if fields:
        output.line(fields)
