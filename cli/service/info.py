"""`service info`."""

from typing import Annotated

from cli import bus, output
from cli.declare import Arg
from cli.names import find_service
from cli.options import Options
from schemas.describe import service_definition
from services.runtime.errors import Unreachable


def info(options: Options, name: Annotated[str, Arg("A service.", complete="service")]) -> None:
    """Show a service's node, key, type and fields.

    Example: quadctl service info calibrate_pressure
    """
    service = find_service(name, options.vehicle)
    key = service.key(options.vehicle)
    with bus.connect(options) as client:
        node = next((offer.node for offer in client.offers() if offer.key == key), None)
    if node is None:
        raise Unreachable(
            f"nobody serves {key} now", f"is {service.node} up? `quadctl status` shows it"
        )
    fields = service_definition(service.request, service.response)
    if options.json:
        said = {"name": service.name, "key": key, "type": service.type_name, "node": node}
        output.document(said | {"definition": fields})
        return
    rows = (("Node", node), ("Key", key), ("Type", service.type_name), ("About", service.doc))
    output.table((f"{title}:", text) for title, text in rows)
    output.line(fields)
