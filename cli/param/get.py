"""`param list|get`: reads the parameters of the running nodes."""

from typing import Annotated, Any

from cli import bus, output
from cli.declare import Arg
from cli.options import Options
from cli.param.names import node_of, nodes_with_params
from schemas.requests import GetParamsRequest
from schemas.topics import get_params


def list_(options: Options) -> None:
    """List every parameter of the running nodes.

    Example: quadctl param list
    """
    names: list[str] = []
    with bus.connect(options) as client:
        for node in nodes_with_params(client):
            names += client.call(get_params(node), GetParamsRequest([])).values
    if options.json:
        output.document(sorted(names))
    else:
        for name in sorted(names):
            output.line(name)


def get(
    options: Options,
    names: Annotated[list[str], Arg("Parameters, or whole tables.", complete="param")],
) -> None:
    """Print the values of parameters.

    Example: quadctl param get safety.virtual_cage.x
    """
    found: dict[str, Any] = {}
    with bus.connect(options) as client:
        for name in names:
            node = node_of(client, name)
            found |= client.call(get_params(node), GetParamsRequest([name])).values
    if options.json:
        output.document(found)
    elif len(found) == 1:
        output.line(str(next(iter(found.values()))))
    else:
        for name, value in found.items():
            output.line(f"{name}: {value}")
