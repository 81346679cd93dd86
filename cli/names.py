"""Lookup of topics, services and types by any name that a user may type."""

from typing import TYPE_CHECKING, Any

from msgspec import Struct

from quadctl.schemas.topics import (
    MESSAGES,
    SERVICES,
    TOPICS,
    Service,
    get_params,
    set_params,
    topic_of,
)
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.names import nearest

if TYPE_CHECKING:
    from quadctl.services.runtime.bus.client import Client

_LONGEST_KEY = 1_000
"""Characters: Zenoh carries no key of 64 KiB, and a user types far fewer than these."""
_LONGEST_NODE = 200
_SPECIAL = frozenset("/#?*$")
_OWN = "own"
"""First part of the names of users' own topics, `VEHICLE/own/...`."""


def key_of(name: str, vehicle: str) -> str:
    """Return the full key of `sensors/pressure`, `own/battery`, `/uav/pose` or any other key."""
    bare = name.strip("/")
    return f"{vehicle}/{bare}" if is_relative(bare, vehicle) else bare


def is_relative(name: str, vehicle: str = "") -> bool:
    """Return whether a name lacks the vehicle's: that of a declared topic, or `own/battery`."""
    own = name.startswith(f"{_OWN}/") and vehicle != _OWN
    return own or any(topic.name == name for topic in TOPICS)


def live_key(client: "Client", key: str) -> str:
    """Return the key of the vehicle's announced topic that a user named without the vehicle.

    Any other key is returned unchanged.
    """
    whole = f"{client.vehicle}/{key}"
    if "*" in key or key.startswith(f"{client.vehicle}/"):
        return key
    live = {offer.key for offer in client.endpoints("@pub", "@sub")}
    return whole if whole in live and key not in live else key


def checked_key(name: str, vehicle: str) -> str:
    """Return the full key or key expression of a name; raise Invalid if Zenoh would reject it.

    An expression is returned in the only spelling that Zenoh accepts: `**/*` as `*/**`.
    """
    key = key_of(name, vehicle)
    while "$*$*" in key:
        key = key.replace("$*$*", "$*")
    if len(key) > _LONGEST_KEY or not all(map(_is_chunk, key.split("/"))):
        raise Invalid(f"'{name[:80]}' is not a valid key", "write it as sensors/pressure or uav/**")
    return _canonical(key) if "*" in key else key


def is_single(key: str) -> bool:
    """Return whether Zenoh accepts the text as one key, not as an expression."""
    return all(map(_is_plain, key.split("/")))


def _is_plain(chunk: str) -> bool:
    return bool(chunk) and _SPECIAL.isdisjoint(chunk)


def _is_chunk(chunk: str) -> bool:
    """Return whether Zenoh accepts a chunk of an expression: plain, or with `*`, `**` or `$*`."""
    return chunk in {"*", "**", "$*"} or _is_plain(chunk.replace("$*", "a"))


def single_key(name: str, vehicle: str) -> str:
    """Return the full key of a name; raise Invalid for an expression, too."""
    key = checked_key(name, vehicle)
    if "*" in key:
        raise Invalid(f"{key} matches many keys", "`quadctl topic list` shows single ones")
    return key


def _canonical(key: str) -> str:
    chunks: list[str] = []
    for chunk in key.split("/"):
        wild = "*" if chunk == "$*" else chunk
        if wild in {"*", "**"} and chunks[-1:] == ["**"]:
            # Zenoh wants `*` before `**`, and `**` once.
            chunks[-1:] = ["*", "**"] if wild == "*" else ["**"]
        else:
            chunks.append(wild)
    return "/".join(chunks)


PARAMETERS: tuple[Service[Any, Any], ...] = (get_params("NODE"), set_params("NODE"))
"""Services that every node has."""


def types() -> dict[str, str]:
    """Return the types' own names by every name that a user may type for them."""
    services = (*SERVICES, *PARAMETERS)
    own = [*MESSAGES]
    own += [service.type_name for service in services]
    own += parts()
    known = {name: name for name in own} | {name.lower(): name for name in own}
    known |= {service.name.removeprefix("NODE/"): service.type_name for service in services}
    return known | {topic.name: topic.type.__name__ for topic in TOPICS}


def parts() -> dict[str, type[Struct]]:
    """Return the types within those of topics and services, e.g. Position in Pose, by name."""
    from quadctl.schemas import typeinfo

    whole = [*MESSAGES.values()]
    whole += [part for one in (*SERVICES, *PARAMETERS) for part in (one.request, one.response)]
    return {part.__name__: part for type_ in whole for part in typeinfo.parts(type_)}


def fields_of(name: str, vehicle: str) -> tuple[str, ...]:
    """Return the fields of a topic's message or a service's request; raise Invalid for neither."""
    topic = topic_of(key_of(name, vehicle))
    type_ = topic.type if topic else find_service(name, vehicle).request
    fields: tuple[str, ...] = type_.__struct_fields__
    return fields


def find_service(name: str, vehicle: str) -> Service[Any, Any]:
    """Return a service by name or key; raise Invalid with the nearest name."""
    bare = name.strip("/")
    for prefix in ("", f"{vehicle}/@srv/", "@srv/", f"{vehicle}/"):
        spelling = bare.removeprefix(prefix)
        for service in SERVICES:
            if spelling == service.name:
                return service
        node, _, verb = spelling.rpartition("/")
        if verb in {"get_params", "set_params"} and _is_plain(node) and len(node) <= _LONGEST_NODE:
            return get_params(node) if verb == "get_params" else set_params(node)
    names = [service.name for service in SERVICES]
    hint = nearest(bare, names) or "`quadctl service list` shows what there is"
    raise Invalid(f"there is no service {name}", hint)
