"""`service call`."""

from typing import Annotated

import msgspec

from cli import bus, output
from cli.arguments import message_of
from cli.declare import Arg
from cli.names import find_service
from cli.options import Options
from services.runtime.errors import Refused


def call(
    options: Options,
    name: Annotated[str, Arg("A service.", complete="service")],
    arguments: Annotated[
        list[str] | None,
        Arg("As zero=true, as JSON, or as values in the fields' order.", complete="field"),
    ] = None,
) -> None:
    """Call a service and print its reply.

    Example: quadctl service call toggle_cage cage_on=false
    """
    service = find_service(name, options.vehicle)
    request = message_of(service.request, service.name, arguments or [])
    with bus.connect(options) as client:
        reply = msgspec.to_builtins(client.call(service, request))
    if options.json:
        output.document(reply)
    else:
        output.fields(reply)
    if reply.get("accepted") is False or reply.get("success") is False:
        raise Refused(reply.get("reason") or f"{service.name} said no")
