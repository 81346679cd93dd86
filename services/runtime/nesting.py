"""Limit on the nesting of data that others sent, the same on every Python. Pure.

How deep a reader goes depends on the Python: 3.11 gives up at 1000 levels, 3.14 reads thousands.
"""

from typing import Any

_DEEPEST = 100
"""Levels: readers of JSON accept that many, and people read fewer."""
TOO_DEEP = f"nested deeper than {_DEEPEST} levels"
_NESTED = {dict, list, tuple}


def is_too_deep(value: Any, text: bytes = b"") -> bool:
    """Return whether plain data has lists and tables on too many levels.

    With its `text`, in JSON, most of it need not be walked through: each level begins with a bracket.
    """
    if text and text.count(b"{") + text.count(b"[") <= _DEEPEST:
        return False
    level = [value] if type(value) in _NESTED else []
    for _ in range(_DEEPEST):
        level = [
            inner
            for outer in level
            for inner in ((*outer, *outer.values()) if type(outer) is dict else outer)
            if type(inner) in _NESTED
        ]
        if not level:
            return False
    return True
