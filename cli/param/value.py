"""A parameter's value as written on a command line. Pure."""

from typing import Any

from services.runtime.errors import Invalid
from services.runtime.params.names import value_of


def read(text: str) -> Any:
    """As TOML has it, or a table or list as JSON or ROS do: `{"x": 3}`, `{x: 3}`; else a word."""
    value = value_of(text)
    if value != text or text.lstrip()[:1] not in {"{", "["}:
        return value
    from cli import flow

    try:
        return flow.read(text)
    except Invalid:
        # A text of a user's own node may begin so, too: what it may be, its node knows.
        return text
