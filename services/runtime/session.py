"""Zenoh sessions as we open them: the hub's router, and everybody else's client.

Nothing listens on a network port and multicast is off. The settings were measured; the
reason stands beside each.
"""

import os
import time
from typing import TYPE_CHECKING, Any

import msgspec
import zenoh
from msgspec import Struct

from services.runtime.errors import TimedOut, Unreachable
from services.runtime.realm import ADDRESS, Realm, write_atomically

if TYPE_CHECKING:
    from schemas.params import Params

TWO_THREADS = (
    "(rx: (worker_threads: 1), acc: (handover: app), tx: (handover: app), net: (handover: app),"
    " app: (worker_threads: 1))"
)
"""One thread that reads and one that writes: each wake spared is processor time spared, and time
of a call. Not one for both: reading waits for room to write in, and one query of a megabyte would
stop the hub for good."""
CLIENT_THREADS = (
    "(rx: (handover: app), acc: (handover: app), tx: (handover: app), net: (handover: app),"
    " app: (worker_threads: 1))"
)
"""One thread for all: what a client reads it does not pass on."""

_RETRY_MS = 10
"""A client waits for a starting hub in steps of this; 10 ms costs nothing and delays nobody."""
_LEASE_MS = 1000
_ROOM_US = 1_000_000
"""The hub waits so long (us) for who has no room for a message that must not be dropped, and then
drops him. Less than the 2 s after which a process that does not answer is taken for frozen."""


class Address(Struct, frozen=True):
    """Where a realm's hub listens; user and password only where it does so on a port."""

    endpoint: str
    user: str = ""
    password: str = ""


def address_of(realm: Realm, connect: str = "") -> Address:
    """`--connect`'s endpoint where one is given, else what the realm's folder says."""
    if connect:
        return Address(connect)
    try:
        with open(f"{realm.path}/{ADDRESS}", "rb") as file:  # noqa: PTH123 - pathlib takes 5 ms
            return msgspec.json.decode(file.read(), type=Address)
    except FileNotFoundError:
        return Address(realm.endpoint)


def open_router(address: Address, params: "Params", realm: Realm) -> zenoh.Session:
    """Open the hub; where it has a password, that is kept in the realm's folder."""
    config = _common(address)
    config["mode"] = "router"
    block = {"wait_before_close": _ROOM_US}
    config["transport"]["link"]["tx"]["queue"] = {"congestion_control": {"block": block}}
    config["listen"] = {"endpoints": [address.endpoint, *params.hub.listen]}
    # Routers sleep this long before they answer; there is nobody to scout for.
    config["scouting"]["delay"] = 0
    if address.user:
        users = realm.folder / "hub.users"
        write_atomically(users, f"{address.user}:{address.password}\n".encode())
        config["transport"]["auth"]["usrpwd"]["dictionary_file"] = str(users)
    return _open(config, TWO_THREADS)


def open_client(
    address: Address, *, wait: float = 0.0, timeout: float = 5.0, threads: str = CLIENT_THREADS
) -> zenoh.Session:
    """Open a client of the hub, waiting up to `wait` seconds for it to come up.

    Who reads so much that its one thread would find no time to say that it lives takes two.

    With a wait the session also reconnects by itself for as long as it lives, and restores
    what it declared. Raises Unreachable when no hub is there, and without a wait TimedOut when
    one is there that has not let us in within `timeout` seconds.
    """
    config, began = _common(address), time.monotonic()
    open_timeout = max(int(timeout * 1000), 1)
    config["transport"]["unicast"] = {"open_timeout": open_timeout}
    config["mode"] = "client"
    config["connect"] = {"endpoints": [address.endpoint]}
    if wait:
        retry = {
            "period_init_ms": _RETRY_MS,
            "period_max_ms": _RETRY_MS,
            "period_increase_factor": 1,
        }
        config["connect"] |= {"timeout_ms": int(wait * 1000), "retry": retry}
        # Samples carry a time, which latched topics and `topic delay` need.
        config["timestamping"] = {"enabled": True}
    try:
        return _open(config, threads)
    except zenoh.ZError as error:
        # Where nobody is there, that is known at once.
        if not wait and time.monotonic() - began >= open_timeout / 1000:
            raise TimedOut(
                f"{address.endpoint} did not answer within {timeout:g} s",
                "is it a hub, is its process frozen, does the network let you through?",
            ) from error
        raise Unreachable(
            f"nothing answers at {address.endpoint}", "start the system with `quadctl up`"
        ) from error


def _common(address: Address) -> dict[str, Any]:
    transport: dict[str, Any] = {
        "shared_memory": {"enabled": False},
        "link": {"tx": {"lease": _LEASE_MS}},
    }
    if address.user:
        transport["auth"] = {"usrpwd": {"user": address.user, "password": address.password}}
    return {"scouting": {"multicast": {"enabled": False}}, "transport": transport}


def _open(config: dict[str, Any], threads: str) -> zenoh.Session:
    # Zenoh reads it from the environment alone, when the process opens its first session. It
    # must not stay there: what this process starts has its own.
    ours = "ZENOH_RUNTIME" not in os.environ
    if ours:
        os.environ["ZENOH_RUNTIME"] = threads
    try:
        return zenoh.open(zenoh.Config.from_json5(msgspec.json.encode(config).decode()))
    finally:
        if ours:
            del os.environ["ZENOH_RUNTIME"]
