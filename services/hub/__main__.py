"""The hub: a Zenoh router that every other process is a client of."""

import zenoh

from schemas.params import Params
from services.runtime.entry import start
from services.runtime.node import Node
from services.runtime.realm import Realm
from services.runtime.session import Address, open_router


def run(node: Node, params: Params) -> None:
    """Route until stopped; Zenoh's own threads do the work."""
    for endpoint in params.hub.listen:
        node.log.info("listening on %s as well", endpoint)
    node.spin()


def opening(address: Address, params: Params, realm: Realm) -> zenoh.Session:
    """Open the router where the realm's folder says."""
    return open_router(address, params.hub.listen, realm)


if __name__ == "__main__":
    start("hub", run, opening)
