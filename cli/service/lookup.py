"""Finding a service: one of ours by its declaration, anybody's by what it tells on the bus."""

from typing import Any

from cli import bus
from cli.names import checked_key, find_service
from cli.options import Options
from schemas.keyexpr import Offer
from schemas.topics import SERVICES, Service
from services.runtime.bus.client import Client
from services.runtime.errors import Invalid, Unreachable
from services.runtime.params.names import nearest

_MARK = "@srv/"


def declared(name: str, vehicle: str) -> Service[Any, Any] | None:
    """One of ours by name or key; None where it may be somebody else's."""
    try:
        return find_service(name, vehicle)
    except Invalid:
        return None


def connect(options: Options, name: str) -> Client:
    """Connect to look for a service; with no hub, a name that nobody knows is the worse fault."""
    try:
        return bus.connect(options)
    except Unreachable:
        if f"/{_MARK}" not in name:
            find_service(name, options.vehicle)
        raise


def offered(client: Client, name: str) -> Offer | None:
    """A live service by name or key."""
    bare = name.strip("/")
    spellings = {bare, bare.removeprefix(_MARK)}
    return next((o for o in services(client) if o.key == bare or o.name in spellings), None)


def key_of(client: Client, name: str) -> tuple[str, str]:
    """The key to call by a name that is none of ours, and the type that is announced, or none.

    A full key is taken as it is, announced or not. Raises Invalid, with the nearest live name,
    for a name that nobody has announced.
    """
    offer = offered(client, name)
    if offer is not None:
        return offer.key, offer.type
    bare = name.strip("/")
    if f"/{_MARK}" not in bare:
        raise unknown(client, name)
    key = checked_key(bare, client.vehicle)
    if "*" in key:
        raise Invalid(
            f"{key} is a pattern, and services are not called by pattern",
            "`quadctl service list` shows the keys",
        )
    return key, ""


def services(client: Client) -> list[Offer]:
    """The live services."""
    return [offer for offer in client.offers() if offer.kind == "@srv"]


def unknown(client: Client, name: str) -> Invalid:
    """The error of who names a service that there is not, with the nearest that there is."""
    hint = nearest_live(client, name) or "`quadctl service list` shows them all"
    return Invalid(f"there is no service {name}", hint)


def nearest_live(client: Client, name: str) -> str:
    """A hint at the service that may be meant; empty where there is none, or it is that name."""
    if offered(client, name) is not None:
        return ""
    live = {offer.name for offer in services(client)}
    bare = name.strip("/").removeprefix(f"{client.vehicle}/").removeprefix(_MARK)
    return nearest(bare, live | {service.name for service in SERVICES})
