"""`topic list|echo`."""

import re
from typing import Annotated, Any

import typer

from cli import bus, options, output
from cli.options import Command
from services.runtime.errors import Invalid

app = typer.Typer(help="What is published.")

_LONGEST_KEY = 1_000
"""Zenoh carries no key of 64 KiB; nobody types one of a thousand characters."""


@app.command("list", cls=Command)
def list_(ctx: typer.Context) -> None:
    """List the live topics with their type, node and declared rate.

    Example: quadctl topic list
    """
    with bus.connect(ctx) as client:
        offers = [offer for offer in client.offers() if offer.kind == "@pub"]
    if options.of(ctx).json:
        output.document(
            [
                {"key": o.key, "type": o.type, "node": o.node, "declared_hz": o.hz, "hash": o.hash}
                for o in offers
            ]
        )
        return
    rows = [(o.key, o.type, o.node, f"{o.hz:g} Hz" if o.hz else "on change") for o in offers]
    output.table([("TOPIC", "TYPE", "NODE", "RATE"), *rows])


@app.command(cls=Command)
def echo(
    ctx: typer.Context,
    topic: Annotated[str, typer.Argument(help="A topic, or any Zenoh key or key expression.")],
    count: Annotated[
        int | None, typer.Option("-n", min=1, help="End after so many messages.")
    ] = None,
    field: Annotated[str, typer.Option(help="Show one field of each message, as position.z.")] = "",
) -> None:
    """Print messages as they come; ends when none comes within the timeout.

    Example: quadctl topic echo sensors/pressure -n 3
    """
    from cli.names import key_of

    as_json = options.of(ctx).json
    with bus.connect(ctx) as client:
        key = key_of(topic, client.vehicle)
        if len(key) > _LONGEST_KEY or not re.fullmatch(r"[^/#?]+(/[^/#?]+)*", key):
            raise Invalid(f"'{topic[:80]}' is no key", "write it as sensors/pressure or uav/**")
        stream = client.listen(key)
        shown = 0
        while count is None or shown < count:
            message = stream.next(client.timeout)
            if message is None:
                raise client.silent(key)
            value = _field(_decode(message), field)
            if as_json:
                output.document(value)
            else:
                output.fields(value)
                if not field:
                    output.line("---")
            shown += 1


def _decode(message: Any) -> Any:
    """A typed message checked against its type, anything else as it can be shown."""
    import msgspec

    from cli.names import topic_of
    from services.runtime import wire
    from services.runtime.plain import plain

    declared = topic_of(message.key)
    if declared is None:
        return plain(message.payload, message.encoding)
    return msgspec.to_builtins(wire.decode(declared.type, message.payload, message.encoding))


def _field(value: Any, path: str) -> Any:
    for part in filter(None, path.split(".")):
        if not isinstance(value, dict) or part not in value:
            has = ", ".join(value) if isinstance(value, dict) else "no fields"
            raise Invalid(f"the message has no field {path}", f"at {part} there is: {has}")
        value = value[part]
    return value
