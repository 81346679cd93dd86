"""Gate: connects other machines to the hub, limited to the rights of their certificates' roles.

As a separate process it keeps foreign traffic out of the process that the vehicle flies by, and
what strangers do interrupts the network at most, but not the flight.
"""

import time
from functools import cached_property
from typing import TYPE_CHECKING

from quadctl.schemas.params import Params
from quadctl.services.runtime.bus import router
from quadctl.services.runtime.bus.router import Session
from quadctl.services.runtime.bus.session import Address, free_port
from quadctl.services.runtime.entry import ReopenSession, start
from quadctl.services.runtime.node import Node
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.security.access_control import Group, groups, identity_for
from quadctl.services.runtime.security.endpoints import secure
from quadctl.services.runtime.security.identity import Name
from quadctl.services.runtime.security.registry import NameList

if TYPE_CHECKING:
    from quadctl.services.gate.door import Door

_LOOKS = 5.0
"""Hz at which the list of names is checked for changes."""


class Gate:
    """Door for TLS, and the routers behind it; the first one also listens for QUIC, and joins."""

    _door: "Door | None" = None

    @cached_property
    def _names(self) -> NameList:
        return NameList(self._identity.folder)

    def open(self, address: Address, params: Params, realm: Realm) -> Session:
        """Open the first router, and then the door; raises as router.open_gate and Door."""
        listen, self._join = secure(params.hub.listen), secure(params.hub.connect)
        self._tls = [endpoint for endpoint in listen if endpoint.startswith("tls/")]
        self._quic = [endpoint for endpoint in listen if endpoint not in self._tls]
        self._identity = identity_for([*listen, *self._join])
        if self._tls and self._door is None:
            # A gate that only joins another needs no asyncio and makes no certificates.
            from quadctl.services.gate.door import Door

            self._door = Door(self._tls, self._identity, realm.folder / "door")
        self._address, self._others = address, dict[int, Session]()
        names = self._names.known
        self._groups, self._met = self._known(names)
        port = free_port()
        inner = [self._door.inner(port)] if self._door else []
        self._first = router.open_gate(address, [*inner, *self._quic], self._join, names)
        if self._door:
            self._door.admit(names)
            self._door.open(port)
        return self._first

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
            known, met = self._known(names)
            if self._is_stale(met):
                node.log.info("the list of names has changed: all clients must reconnect")
                if self._door:
                    self._door.end_links()
                for other in self._others.values():
                    other.close()
                raise ReopenSession
            if self._door:
                if not known <= self._groups:
                    self._groups = known
                    self._open_another(self._door)
                self._door.admit(names)

    def _known(self, names: list[Name]) -> tuple[set[Group], set[str]]:
        """Return the groups, and the certificates' common names that Zenoh itself meets.

        It meets a client's by QUIC, and a hub's where we join that hub.
        """
        members = groups(names, time.time())
        return set(members), {
            certificate
            for (role, _), certificates in members.items()
            for certificate in certificates
            if self._quic or (self._join and role == "hub")
        }

    def _is_stale(self, met: set[str]) -> bool:
        """Return whether the first router needs the new list: a name went, or is waited for."""
        if self._quic or self._met - met:
            return met != self._met
        joined = len(self._first.info.routers_zid()) > len(self._join)
        return met != self._met and not joined

    def _open_another(self, door: "Door") -> None:
        """Open a router that knows the new groups for all links to come; the others stay as is."""
        for port in self._others.keys() - door.ports():
            self._others.pop(port).close()
        port = free_port()
        self._others[port] = router.open_gate(
            self._address, [door.inner(port)], [], self._names.known
        )
        door.open(port)


if __name__ == "__main__":
    gate = Gate()
    start("gate", gate.run, gate.open, keeps_time=True)
