"""Hub: the Zenoh router to which every other process connects as a client."""

from quadctl.schemas.params import Params
from quadctl.services.runtime.bus import router
from quadctl.services.runtime.bus.router import open_router
from quadctl.services.runtime.entry import start
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.security.endpoints import plain


def run(node: Node, params: Params) -> None:
    """Route until stopped; Zenoh's own threads do the work."""
    for endpoint in plain(params.hub.listen):
        node.log.info("listening on %s as well", endpoint)
    if not plain([*params.hub.listen, *params.hub.connect]):
        node.spin()
        return
    for _ in node.ticks(router.LOOKS):
        router.disable_tcp_linger()


if __name__ == "__main__":
    start("hub", run, open_router, keeps_time=True)
