"""Tables as ROS's completion inserts them, `x: 1` line by line: the block style of YAML."""

import re
from typing import Any

from cli import flow
from services.runtime.errors import Invalid

_NAMED = re.compile(r"([A-Za-z_]\w*):(?:\s+(.*))?$")
_ITEM = re.compile(r"-(?:\s+(.*))?$")
_DEEPEST = 50

_Lines = list[tuple[int, str]]
"""Lines with how far each is indented, the next one last."""


def read(text: str) -> Any:
    """The value that lines in block style stand for; raises Invalid."""
    lines = [(len(line) - len(line.lstrip()), line.strip()) for line in text.splitlines()]
    rest = [line for line in reversed(lines) if line[1]]
    found = _value(rest)
    if rest:
        raise Invalid(f"it cannot be read from {rest[-1][1][:20]!r} on")
    return found


def _value(lines: _Lines, depth: int = 0) -> Any:
    indent, text = lines[-1]
    if depth > _DEEPEST:
        raise Invalid(f"it is nested deeper than {_DEEPEST} levels")
    if _ITEM.match(text):
        items: list[Any] = []
        while found := _next(lines, indent, _ITEM):
            if found[1]:
                # What follows a dash stands as if on a line of its own, as far to the right.
                lines.append((indent + found.start(1), found[1]))
            items.append(_below(lines, indent + 1, depth))
        return items
    if _NAMED.match(text):
        table: dict[str, Any] = {}
        while found := _next(lines, indent, _NAMED):
            # The items of a list may stand right below its name.
            listed = bool(lines) and bool(_ITEM.match(lines[-1][1]))
            table[found[1]] = (
                _scalar(found[2]) if found[2] else _below(lines, indent + (not listed), depth)
            )
        return table
    return _scalar(lines.pop()[1])


def _next(lines: _Lines, indent: int, form: re.Pattern[str]) -> re.Match[str] | None:
    """The next line, taken, if it is another of the same list or table."""
    found = form.match(lines[-1][1]) if lines and lines[-1][0] == indent else None
    if found:
        lines.pop()
    return found


def _below(lines: _Lines, indent: int, depth: int) -> Any:
    """What is indented at least so far; nothing is null."""
    return _value(lines, depth + 1) if lines and lines[-1][0] >= indent else None


def _scalar(text: str) -> Any:
    return flow.read(text) if text[0] in "{['\"" else flow.scalar(text)
