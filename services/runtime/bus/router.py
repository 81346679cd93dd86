"""Open the hub and the gate: Zenoh's router sessions."""

import os
from typing import TYPE_CHECKING, Any

import zenoh

from services.runtime.bus.session import (
    INSECURE,
    JOIN_MS,
    LEASE_AFAR_MS,
    TWO_THREADS,
    Address,
    common_config,
    open_with,
    retry,
)
from services.runtime.errors import QuadctlError, UsageError
from services.runtime.realm import Realm, write_atomically
from services.runtime.secure import endpoints

if TYPE_CHECKING:
    from schemas.params import Params

_ROOM_US = 1_000_000
"""The hub waits so long (us) for who has no room for a message that must not be dropped, and then
drops him. Less than the 2 s after which a process that does not answer is taken for frozen."""


def open_router(address: Address, params: "Params", realm: Realm) -> zenoh.Session:
    """Open the hub; where it has a password, that is kept in the realm's folder.

    It knows no encryption: what is to have that is the gate's. Raises UsageError for an endpoint
    that would let in everybody.
    """
    listen, join = endpoints.plain(params.hub.listen), endpoints.plain(params.hub.connect)
    if not os.environ.get(INSECURE):
        endpoints.refuse_open((*listen, *join))
    config = _router(address)
    config["listen"] = {"endpoints": [address.endpoint, *listen]}
    config["connect"] |= {"endpoints": join}
    if address.user:
        users = realm.folder / "hub.users"
        write_atomically(users, f"{address.user}:{address.password}\n".encode())
        config["transport"]["auth"]["usrpwd"]["dictionary_file"] = str(users)
    return open_with(config, TWO_THREADS)


def open_gate(address: Address, params: "Params", realm: Realm) -> zenoh.Session:  # noqa: ARG001 - as open_router
    """Open the encrypted side of the hub: a router of its own, a process away from the vehicle.

    It lets through what the roles allow. Raises UsageError where no hub's identity is given, or the
    hub has no Unix socket.
    """
    from services.runtime.secure import gate

    if address.user:
        raise UsageError(
            "tls and quic need a hub on a Unix socket",
            "leave hub.transport at auto; Windows has no such socket",
        )
    listen, join = endpoints.secure(params.hub.listen), endpoints.secure(params.hub.connect)
    config = _router(address)
    config["connect"] |= {"endpoints": [address.endpoint, *join]}
    config["listen"] = {"endpoints": listen}
    who = gate.identity_for([*listen, *join])
    link = config["transport"]["link"]
    link["tls"] = who.tls()
    link["tx"]["lease"] = LEASE_AFAR_MS
    protocol = address.endpoint.partition("/")[0]
    config["access_control"] = gate.rules(who, protocol)
    try:
        return open_with(config, TWO_THREADS)
    except zenoh.ZError as error:
        raise QuadctlError(
            f"{', '.join(listen) or 'the gate'} cannot be opened: {_plainly(error)}",
            "is the port another's, or the address not this machine's?",
        ) from error


def _router(address: Address) -> dict[str, Any]:
    config = common_config(address)
    config["mode"] = "router"
    block = {"wait_before_close": _ROOM_US}
    config["transport"]["link"]["tx"]["queue"] = {"congestion_control": {"block": block}}
    # Who is not there now may come at any time.
    config["connect"] = {"timeout_ms": -1, "exit_on_failure": False, "retry": retry(JOIN_MS)}
    # Routers sleep this long before they answer; there is nobody to scout for.
    config["scouting"]["delay"] = 0
    return config


def _plainly(error: zenoh.ZError) -> str:
    """What Zenoh says, without the places in its source."""
    return str(error).partition(" at /")[0].rstrip(". ")
