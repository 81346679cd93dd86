"""Gate: connects other machines to the hub, limited to the rights of their certificates' roles.

As a separate process it keeps foreign traffic out of the process that the vehicle flies by, and
what strangers do interrupts the network at most, but not the flight.
"""

import time
from typing import TYPE_CHECKING

from quadctl.schemas.params import Params
from quadctl.services.runtime.bus import router
from quadctl.services.runtime.bus.router import Session
from quadctl.services.runtime.bus.session import Address
from quadctl.services.runtime.entry import ReopenSession, start
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.security.access_control import NameList, groups, identity_for
from quadctl.services.runtime.security.endpoints import secure
from quadctl.services.runtime.security.identity import Name

if TYPE_CHECKING:
    from quadctl.services.gate.door import Door

_LOOKS = 5.0
"""Hz at which the list of names is checked for changes."""


class Gate:
    """Door for TLS, and the router behind it, which listens for QUIC itself."""

    _door: "Door | None" = None

    def open(self, address: Address, params: Params, realm: Realm) -> Session:
        """Open the router, and at first the door; raises as router.open_gate and Door."""
        listen, self._join = secure(params.hub.listen), secure(params.hub.connect)
        self._tls = [endpoint for endpoint in listen if endpoint.startswith("tls/")]
        self._quic = [endpoint for endpoint in listen if endpoint not in self._tls]
        self._identity = identity_for([*listen, *self._join])
        if self._tls and self._door is None:
            # A gate that only joins another needs no asyncio and makes no certificates.
            from quadctl.services.gate.door import Door

            self._door = Door(self._tls, self._identity, realm.folder / "door")
            self._door.open()
        self._names = NameList(self._identity.folder)
        self._known = self._names_that_count(self._names.changed() or [])
        inner = [self._door.inner] if self._door else []
        return router.open_gate(address, [*inner, *self._quic], self._join)

    def run(self, node: Node, _params: Params) -> None:
        """Route until stopped, or until a change of the list of names needs a new session."""
        if not node.is_first:
            node.spin()
            return
        name = self._identity.name.common_name
        for endpoint in (*self._tls, *self._quic):
            node.log.info("listening on %s as %s", endpoint, name)
        for endpoint in self._join:
            node.log.info("joining %s as %s", endpoint, name)
        for _ in node.ticks(_LOOKS):
            if self._join:
                router.disable_tcp_linger()
            if (names := self._names.changed()) is None:
                continue
            found = self._names_that_count(names)
            if found != self._known if self._quic or self._join else not found <= self._known:
                node.log.info("the list of names has changed: all clients must reconnect")
                if self._door:
                    self._door.end_links()
                raise ReopenSession

    def _names_that_count(self, names: list[Name]) -> set[object]:
        """Give the door the list; return what Zenoh has to know of it."""
        if self._door:
            self._door.admit(names)
        members = groups(names, time.time())
        found: set[object] = set(members)
        # Zenoh meets a client's own certificate by QUIC, and a hub's where we join that hub.
        for (role, _), certificates in members.items():
            if self._quic or (self._join and role == "hub"):
                found.update(certificates)
        return found


if __name__ == "__main__":
    gate = Gate()
    start("gate", gate.run, gate.open)
