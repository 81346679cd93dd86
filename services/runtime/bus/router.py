"""Router sessions of the hub and the gate, and their TCP links without linger."""

import os
import socket
import struct
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import zenoh

from quadctl.services.runtime.bus import session
from quadctl.services.runtime.bus.session import Address
from quadctl.services.runtime.errors import QuadctlError, UsageError
from quadctl.services.runtime.realm import Realm, write_atomically
from quadctl.services.runtime.security import endpoints

if TYPE_CHECKING:
    from quadctl.schemas.params import Params
    from quadctl.services.runtime.security.identity import Name

Session = zenoh.Session
LOOKS = 2.0
"""Rate (Hz) of a router's search for new links; none is given up within a second."""
_CALLS = 16
"""Batches of 64 KB of calls that may wait for a receiver: those of a mission, 5000, take 12."""
_SHORT = 60_000
"""Most bytes of a call that fits into one batch."""
_LARGEST_OF_STRANGERS = 2**20
"""Most bytes of a message in a run with nodes of strangers, each of which has to be stored."""
_OFF = struct.pack("ii", 0, 0)


def disable_tcp_linger() -> None:
    """Make this process close every TCP link without waiting for data in transit.

    Zenoh makes the kernel wait up to 10 s, without a setting: a link to a dead machine would block
    the router's thread that closes it, and all traffic of the router, for that time.
    """
    if sys.platform == "win32":
        return
    for name in os.listdir("/dev/fd"):  # noqa: PTH208 - pathlib is slow
        try:
            copy = os.dup(int(name))
        except OSError:
            continue  # the listing's own, or closed since
        try:
            link = socket.socket(fileno=copy)
        except OSError:
            os.close(copy)
            continue  # no socket
        with link:
            if link.family != socket.AF_UNIX and link.type == socket.SOCK_STREAM:
                link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)


def open_router(address: Address, params: "Params", realm: Realm) -> Session:
    """Open the hub with its plain endpoints; raise UsageError if one is open to everybody."""
    listen, join = endpoints.plain(params.hub.listen), endpoints.plain(params.hub.connect)
    if not os.environ.get(session.INSECURE):
        endpoints.refuse_open((*listen, *join))
    config = _router(address)
    config["listen"] = {"endpoints": [address.endpoint, *listen]}
    config["connect"] |= {"endpoints": join}
    if address.user:
        nodes, users = session.addresses_of_nodes(realm), realm.folder / "hub.users"
        lines = (f"{each.user}:{each.password}\n" for each in (address, *nodes))
        write_atomically(users, "".join(lines).encode())
        config["transport"]["auth"]["usrpwd"]["dictionary_file"] = str(users)
        if nodes:
            from quadctl.services.runtime.security import access_control

            config["transport"]["link"]["rx"] = {"max_message_size": _LARGEST_OF_STRANGERS}
            config["access_control"] = access_control.for_nodes(
                address.user, [node.user for node in nodes]
            )
    return _opened(config, ", ".join(listen) or "the hub")


def open_gate(
    address: Address, listen: Sequence[str], join: Sequence[str], names: "Sequence[Name]"
) -> Session:
    """Open the encrypted side of the hub: a separate router, a process away from the vehicle.

    It passes what the roles of the names allow. Raises UsageError if the hub has no identity or Unix socket.
    """
    from quadctl.services.runtime.security import access_control

    if address.user:
        raise UsageError(
            "tls and quic need a hub on a Unix socket",
            "leave hub.transport at auto; Windows has no such socket",
        )
    config = _router(address)
    config["connect"] |= {"endpoints": [address.endpoint, *join]}
    config["listen"] = {"endpoints": list(listen)}
    who = access_control.identity_for([*listen, *join])
    link = config["transport"]["link"]
    link["tls"] = who.tls()
    link["tx"]["lease"] = session.LEASE_AFAR_MS
    protocol = address.endpoint.partition("/")[0]
    config["access_control"] = access_control.access_control(names, time.time(), protocol)
    return _opened(config, ", ".join(listen) or "the gate")


def _opened(config: dict[str, Any], what: str) -> zenoh.Session:
    try:
        return session.open_with(config, session.TWO_THREADS)
    except zenoh.ZError as error:
        # Without the positions in Zenoh's source code.
        why = str(error).partition(" at /")[0].rstrip(". ")
        raise QuadctlError(
            f"{what} cannot be opened: {why}",
            "is the port in use, or the address that of another machine?",
        ) from error


def _router(address: Address) -> dict[str, Any]:
    config = session.common_config(address)
    config["mode"] = "router"
    # A receiver without room for a message that must not be dropped is waited for. The router reads
    # nothing meanwhile, but the lease of its clients is twice as long.
    block = {"wait_before_close": 1000 * address.lease_ms}
    config["transport"]["link"]["tx"]["queue"] = {
        "congestion_control": {"block": block}, "size": {"data_low": _CALLS},
    }  # fmt: skip
    # Calls have a queue of their own, and those for which it has no room are lost: if the router
    # waited for a node that is flooded with calls, nothing else would pass. A call of megabytes
    # never has room at once, so it is waited for.
    calls = {"messages": ["query"], "flows": ["ingress"], "payload_size": f"..{_SHORT}"}
    own_queue = {"congestion_control": "drop", "priority": "data_low"}
    config["qos"] = {"network": [calls | {"overwrite": own_queue}]}
    # Another hub may start at any time.
    retry = session.retry(session.JOIN_MS)
    config["connect"] = {"timeout_ms": -1, "exit_on_failure": False, "retry": retry}
    # Routers sleep this long before they answer; we do not scout.
    config["scouting"]["delay"] = 0
    return config
