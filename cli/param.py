"""`param list|get|set`: the parameters of the running nodes."""

from typing import Annotated, Any

import typer

from cli import bus, options, output
from cli.options import Command
from services.runtime.errors import Invalid, UsageError

app = typer.Typer(help="Parameters of the running system.")


@app.command("list", cls=Command)
def list_(ctx: typer.Context) -> None:
    """List every parameter of the running nodes.

    Example: quadctl param list
    """
    values = _all(ctx)
    if options.of(ctx).json:
        output.document(sorted(values))
    else:
        for name in sorted(values):
            output.line(name)


@app.command(cls=Command)
def get(
    ctx: typer.Context,
    names: Annotated[list[str], typer.Argument(help="Parameters, or whole tables.")],
) -> None:
    """Print the values of parameters.

    Example: quadctl param get safety.virtual_cage.x
    """
    from schemas.requests import GetParamsRequest
    from schemas.topics import get_params

    found: dict[str, Any] = {}
    with bus.connect(ctx) as client:
        for name in names:
            node = _node_of(client, name)
            found |= client.call(get_params(node), GetParamsRequest([name])).values
    if options.of(ctx).json:
        output.document(found)
    elif len(found) == 1:
        output.line(str(next(iter(found.values()))))
    else:
        for name, value in found.items():
            output.line(f"{name}: {value}")


@app.command("set", cls=Command, context_settings={"ignore_unknown_options": True})
def set_(
    ctx: typer.Context,
    words: Annotated[list[str], typer.Argument(metavar="NAME VALUE | NAME=VALUE...")],
) -> None:
    """Change parameters of one running node at once: all of them or none.

    Example: quadctl param set safety.virtual_cage.x 3
    """
    from schemas.requests import SetParamsRequest
    from schemas.topics import set_params
    from services.runtime.params import normal_name, value_of

    if len(words) == 2 and "=" not in words[0]:
        words = [f"{words[0]}={words[1]}"]
    if not all("=" in word for word in words):
        raise UsageError("param set takes NAME VALUE or NAME=VALUE...")
    pairs = (word.partition("=") for word in words)
    values = {normal_name(name): value_of(text) for name, _, text in pairs}
    nodes = {name.partition(".")[0] for name in values}
    if len(nodes) > 1:
        raise UsageError(
            f"these belong to different nodes: {', '.join(sorted(nodes))}",
            "set one node's parameters at a time, so that all are taken or none",
        )
    with bus.connect(ctx) as client:
        node = _node_of(client, next(iter(values)))
        reply = client.call(set_params(node), SetParamsRequest(values))
    if not reply.success:
        raise Invalid(reply.reason, "nothing was changed")
    if options.of(ctx).json:
        output.document(values)
    else:
        for name, value in values.items():
            output.line(f"{name}: {value}")


def _node_of(client: Any, name: str) -> str:
    """The live node that a parameter belongs to; raises Invalid with the nearest name."""
    from services.runtime.params import nearest, normal_name
    from services.runtime.processes import NODES

    node = normal_name(name).partition(".")[0]
    live = {o.node for o in client.offers() if o.type == "GetParams"}
    if node in live or node in NODES or not live:
        return node
    hint = nearest(node, live) or f"the nodes with parameters are {', '.join(sorted(live))}"
    raise Invalid(f"there is no parameter {name}: no node {node} is up", hint)


def _all(ctx: typer.Context) -> dict[str, Any]:
    from schemas.requests import GetParamsRequest
    from schemas.topics import get_params

    values: dict[str, Any] = {}
    with bus.connect(ctx) as client:
        for node in sorted({o.node for o in client.offers() if o.type == "GetParams"}):
            values |= client.call(get_params(node), GetParamsRequest([])).values
    return values
