"""`service list|info|call`."""

from typing import Annotated, Any

import typer

from cli import bus, options, output
from cli.options import Command
from services.runtime.errors import Invalid, Refused

app = typer.Typer(help="What can be called.")


@app.command("list", cls=Command)
def list_(ctx: typer.Context) -> None:
    """List the live services with their type and node.

    Example: quadctl service list
    """
    with bus.connect(ctx) as client:
        offers = [offer for offer in client.offers() if offer.kind == "@srv"]
    if options.of(ctx).json:
        output.document(
            [{"name": o.name, "key": o.key, "type": o.type, "node": o.node} for o in offers]
        )
        return
    output.table([("SERVICE", "TYPE", "NODE"), *((o.name, o.type, o.node) for o in offers)])


@app.command(cls=Command)
def info(ctx: typer.Context, name: Annotated[str, typer.Argument()]) -> None:
    """Show a service's node, key, type and fields.

    Example: quadctl service info calibrate_pressure
    """
    from cli.names import find_service
    from schemas.describe import service_definition
    from services.runtime.errors import Unreachable

    service = find_service(name, options.of(ctx).vehicle)
    with bus.connect(ctx) as client:
        key = service.key(client.vehicle)
        node = next((o.node for o in client.offers() if o.key == key), None)
    if node is None:
        raise Unreachable(
            f"nobody serves {key} now", f"is {service.node} up? `quadctl status` shows it"
        )
    fields = service_definition(service.request, service.response)
    if options.of(ctx).json:
        said = {"name": service.name, "key": key, "type": service.type_name, "node": node}
        output.document(said | {"definition": fields})
        return
    rows = (("Node", node), ("Key", key), ("Type", service.type_name), ("About", service.doc))
    output.table((f"{title}:", text) for title, text in rows)
    output.line(fields)


@app.command(cls=Command, context_settings={"ignore_unknown_options": True})
def call(
    ctx: typer.Context,
    name: Annotated[str, typer.Argument()],
    arguments: Annotated[
        list[str] | None,
        typer.Argument(help="As zero=true, as JSON, or as values in the fields' order."),
    ] = None,
) -> None:
    """Call a service and print its reply.

    Example: quadctl service call toggle_cage cage_on=false
    """
    import msgspec

    from cli.names import find_service

    chosen = options.of(ctx)
    service = find_service(name, chosen.vehicle)
    request = _request(service, arguments or [])
    with bus.connect(ctx) as client:
        reply = msgspec.to_builtins(client.call(service, request))
    if chosen.json:
        output.document(reply)
    else:
        output.fields(reply)
    if reply.get("accepted") is False or reply.get("success") is False:
        raise Refused(reply.get("reason") or f"{service.name} said no")


def _request(service: Any, words: list[str]) -> Any:
    import msgspec

    from services.runtime.params import value_of

    names = service.request.__struct_fields__
    if len(words) == 1 and words[0].startswith("{"):
        try:
            table = msgspec.json.decode(words[0])
        except msgspec.DecodeError as error:
            raise Invalid(f"the argument is not JSON: {error}", '{"zero": true}') from error
    elif all("=" in word for word in words):
        pairs = (word.partition("=") for word in words)
        table = {name: value_of(text) for name, _, text in pairs}
    elif len(words) <= len(names):
        table = {name: value_of(word) for name, word in zip(names, words, strict=False)}
    else:
        raise Invalid(f"{service.name} takes {len(names)} values", f"the fields are: {names}")
    try:
        return msgspec.convert(table, service.request)
    except msgspec.ValidationError as error:
        raise Invalid(
            f"not a valid {service.type_name} request: {error}",
            f"`quadctl type show {service.name}` prints the fields",
        ) from error
