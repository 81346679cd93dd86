"""Tables as ROS users write them, `{x: 1, pose: {y: 2}}`: the flow style of YAML, on one line."""

import re
from typing import Any

from cli.arguments import value
from services.runtime.errors import Invalid

_TOKEN = re.compile(
    r"""\s*([{}\[\],:]|"(?:[^"\\]|\\.)*"|'(?:[^']|'')*'|[^{}\[\],:"'\s][^{}\[\],:]*)"""
)
_DEEPEST = 50


def read(text: str) -> Any:
    """The value that a text in flow style stands for; raises Invalid."""
    tokens: list[str] = []
    at = 0
    while rest := text[at:].strip():
        found = _TOKEN.match(text, at)
        if found is None:
            raise Invalid(f"it cannot be read from {rest[:20]!r} on")
        tokens.append(found[1].strip())
        at = found.end()
    tokens.reverse()
    value = _value(tokens)
    if tokens:
        raise Invalid(f"after its end there is {tokens[-1]!r}")
    return value


def _value(tokens: list[str], depth: int = 0) -> Any:
    word = _next(tokens, "a value")
    if depth > _DEEPEST:
        raise Invalid(f"it is nested deeper than {_DEEPEST} levels")
    if word == "{":
        table: dict[str, Any] = {}
        while not _ends(tokens, "}", first=not table):
            name = scalar(_next(tokens, "a field"))
            if (colon := _next(tokens, "':'")) != ":":
                raise Invalid(f"after {name} there is {colon!r} in place of ':'")
            table[str(name)] = _value(tokens, depth + 1)
        return table
    if word == "[":
        items: list[Any] = []
        while not _ends(tokens, "]", first=not items):
            items.append(_value(tokens, depth + 1))
        return items
    return scalar(word)


def _ends(tokens: list[str], end: str, *, first: bool) -> bool:
    """Whether a table or list ends here; takes the end, and the comma before it or another item."""
    if not first and tokens[-1:] != [end] and (comma := _next(tokens, repr(end))) != ",":
        raise Invalid(f"there is {comma!r} in place of ',' or {end!r}")
    if tokens[-1:] == [end]:
        tokens.pop()
        return True
    return False


def _next(tokens: list[str], wanted: str) -> str:
    if not tokens:
        raise Invalid(f"it ends where {wanted} should be")
    return tokens.pop()


def scalar(word: str) -> Any:
    """One value that is neither a table nor a list."""
    if word[0] == "'":
        return word[1:-1].replace("''", "'")
    if word in set("{}[],:"):
        raise Invalid(f"there is {word!r} in place of a value")
    return None if word in {"null", "~"} else value(word)
