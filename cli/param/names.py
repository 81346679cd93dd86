"""Which live node a parameter belongs to."""

from services.runtime.bus.client import Client
from services.runtime.errors import Invalid
from services.runtime.params.names import nearest
from services.runtime.process_table import NODES


def nodes_with_params(client: Client) -> list[str]:
    """The live nodes that have parameters."""
    return sorted({offer.node for offer in client.offers() if offer.type == "GetParams"})


def node_of(name: str, live: list[str]) -> str:
    """The one of the live nodes that a parameter belongs to; raises Invalid with the nearest name.

    A node of ours may just be away.
    """
    node = name.partition(".")[0]
    if node in live or node in NODES or not live:
        return node
    hint = nearest(node, live) or f"the nodes with parameters are {', '.join(live)}"
    raise Invalid(f"there is no parameter {name}: no node {node} is up", hint)
