"""Text for a terminal, without characters that control it or hide what the text says.

Anybody on the bus may send such characters, e.g. U+202E, which shows the text after it backwards.
"""

from typing import Any

import msgspec


def escaped(text: str) -> str:
    """Return a text with Python's escapes for all but printable characters, tabs and newlines."""
    if text.isprintable():
        return text
    return "".join(
        each if each.isprintable() or each in "\t\n" else each.encode("unicode_escape").decode()
        for each in text
    )


def escaped_json(value: Any) -> str:
    """Return a value as JSON, with JSON's own escapes for the characters not printable."""
    text = msgspec.json.encode(value).decode()
    return text if text.isprintable() else "".join(map(_in_json, text))


def _in_json(character: str) -> str:
    if character.isprintable():
        return character
    # Two units beyond U+FFFF.
    units = character.encode("utf-16-be").hex(" ", 2).split()
    return "".join(f"\\u{unit}" for unit in units)
