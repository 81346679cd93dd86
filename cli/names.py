"""From what a user types to what there is: topics, services and types by any of their names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from schemas.topics import SERVICES, TOPICS, get_params, set_params
from services.runtime.errors import Invalid
from services.runtime.params import nearest

if TYPE_CHECKING:
    from schemas.contract import Service, Topic


def key_of(name: str, vehicle: str) -> str:
    """`sensors/pressure`, `/uav/sensors/pressure` or any other key, to the full key."""
    bare = name.strip("/")
    declared = {topic.name for topic in TOPICS}
    return f"{vehicle}/{bare}" if bare in declared else bare


def topic_of(key: str) -> Topic[Any] | None:
    """The declared topic that a full key belongs to, whatever the vehicle."""
    _, _, name = key.partition("/")
    return next((topic for topic in TOPICS if topic.name == name), None)


def find_service(name: str, vehicle: str) -> Service[Any, Any]:
    """A service by name or key; raises Invalid with the nearest name."""
    bare = name.strip("/")
    for prefix in ("", f"{vehicle}/@srv/", "@srv/", f"{vehicle}/"):
        spelling = bare.removeprefix(prefix)
        for service in SERVICES:
            if spelling == service.name:
                return service
        node, _, verb = spelling.rpartition("/")
        if verb in {"get_params", "set_params"} and node and "/" not in node:
            return get_params(node) if verb == "get_params" else set_params(node)
    names = [service.name for service in SERVICES]
    hint = nearest(bare, names) or "`quadctl service list` shows what there is"
    raise Invalid(f"there is no service {name}", hint)
