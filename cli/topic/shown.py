"""A message of any key, as it can be shown."""

from typing import Any

import msgspec

from cli.names import topic_of
from services.runtime import wire
from services.runtime.client import Message
from services.runtime.plain import plain


def shown(message: Message) -> Any:
    """A typed message checked against its type, anything else as it can be read."""
    declared = topic_of(message.key)
    if declared is None:
        return plain(message.payload, message.encoding)
    return msgspec.to_builtins(wire.decode(declared.type, message.payload, message.encoding))
