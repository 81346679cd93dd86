"""Gate: connects other machines to the hub, limited to the rights of their certificates' roles.

As a separate process it keeps foreign traffic out of the process that the vehicle flies by, and
revoking a name interrupts the network for a moment but not the flight.
"""

from quadctl.schemas.params import Params
from quadctl.services.runtime.bus import router
from quadctl.services.runtime.bus.router import open_gate
from quadctl.services.runtime.entry import ReopenSession, start
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.security.access_control import RevocationWatch, identity_for
from quadctl.services.runtime.security.endpoints import secure

_LOOKS = 5.0
"""Hz at which the list of names is checked for changes."""


def run(node: Node, params: Params) -> None:
    """Route until stopped, or until the list of names changes."""
    if not node.is_first:
        node.spin()
        return
    listen, join = secure(params.hub.listen), secure(params.hub.connect)
    identity = identity_for([*listen, *join])
    for endpoint in listen:
        node.log.info("listening on %s as %s", endpoint, identity.name.common_name)
    for endpoint in join:
        node.log.info("joining %s as %s", endpoint, identity.name.common_name)
    watch = RevocationWatch(identity.folder)
    for _ in node.ticks(_LOOKS):
        router.disable_tcp_linger()
        if watch.changed():
            node.log.info("the list of names has changed: all clients must reconnect")
            router.cut_tcp_links()
            raise ReopenSession


if __name__ == "__main__":
    start("gate", run, open_gate)
