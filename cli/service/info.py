"""`service info`."""

from typing import Annotated

from cli import output
from cli.declare import Arg
from cli.options import Options
from cli.service import lookup
from cli.which import about_service
from schemas.typeinfo import service_definition
from services.runtime.errors import Unreachable


def info(options: Options, name: Annotated[str, Arg("A service.", complete="service")]) -> None:
    """Show a service's node, key, type and fields; of one of your own, what it tells on the bus.

    Example: quadctl service info calibrate_pressure
    """
    options = about_service(options, name)
    ours = lookup.declared(name, options.vehicle)
    with lookup.connect(options, name) as client:
        offer = lookup.offered(client, ours.key(client.vehicle) if ours else name)
        if offer is None and ours is None:
            raise lookup.unknown(client, name)
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
