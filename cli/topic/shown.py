"""A message of any key, as it can be shown."""

from typing import Any

import msgspec

from schemas.topics import topic_of
from services.runtime.bus import codec
from services.runtime.bus.codec import plain
from services.runtime.bus.streams import Message
from services.runtime.errors import Invalid


class NoField(Invalid):
    """A message has no such field."""


def shown(message: Message, key: str, vehicle: str) -> Any:
    """A message of our topics checked against its type, anything else as it can be read.

    `key` is what was listened to, and tells the topic where it is not an expression.
    What another vehicle, or no vehicle at all, publishes under a topic's name is ours only where
    its encoding says so. Raises Invalid for what cannot be read.
    """
    of = message.key if "*" in key else key
    declared = topic_of(of)
    ours = of.startswith(f"{vehicle}/") or codec.is_typed(message.encoding)
    if declared is None or not ours:
        return plain(message.payload, message.encoding)
    return msgspec.to_builtins(codec.decode(declared.type, message.payload, message.encoding))


def field_of(value: Any, path: str) -> Any:
    """One field of a message by its path, as `position.z`, `position/z` or `values.0`.

    Raises NoField.
    """
    within, left = "", path.split(".")[::-1]
    while left:
        part = left.pop()
        if isinstance(value, dict) and part in value:
            value = value[part]
        elif isinstance(value, list) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        elif "/" in part:
            # As ROS writes it; a stranger's field may have it in its name.
            left += part.split("/")[::-1]
            continue
        elif part:
            where = f"in {within or 'the message'} there is: {_has(value)}"
            raise NoField(f"the message has no field {path}", where)
        within = f"{within}.{part}".strip(".")
    return value


def _has(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(value) or "an empty table"
    if isinstance(value, list):
        return f"a list of {len(value)}" + (", counted from 0" if value else "")
    return "no fields"
