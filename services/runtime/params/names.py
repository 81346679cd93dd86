"""Dotted names of values, as users write them: `safety.virtual_cage.x=3`."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from quadctl.services.runtime.errors import Invalid

LAB_NODES = {
    "state_safety_node": "safety",
    "pressure_node": "pressure",
    "pressure_sensor_node": "pressure",
    "dynamics_node": "dynamics",
}
"""Node names in the lab's ROS packages, and our names of the same nodes."""

_BOOLS = {"true": True, "false": False, "True": True, "False": False}


_LONGEST = 400
"""Characters of a number: Python refuses integers of more than 4300 digits."""
_IN_NUMBERS = frozenset("0123456789+-.eE")
MOST_PARTS = 50
_ENDLESS_KEY = rf"""(?:\.[ \t]*+(?:"[^"\n]*+"|'[^'\n]*+'|[\w-]++)[ \t]*+){{{MOST_PARTS}}}"""


def has_endless_key(text: str) -> bool:
    """Return whether a TOML text has a dotted key of which tomllib would take minutes.

    Its time grows with the square of the key's parts.
    """
    import re

    return re.search(_ENDLESS_KEY, text) is not None


def _number(text: str) -> int | float | None:
    """Parse a decimal number, also `.5`, `5.` and `007`, which TOML refuses; None for other text."""
    if len(text) <= _LONGEST and _IN_NUMBERS.issuperset(text):
        for kind in (int, float):
            with suppress(ValueError):
                return kind(text)
    return None


def value_of(text: str) -> Any:
    """Parse a value from a command line: a number, TOML's notation, ROS's True and False, or a word."""
    if text in _BOOLS:
        return _BOOLS[text]
    if (number := _number(text)) is not None:
        return number
    if has_endless_key(text):
        return text
    import tomllib  # with re, it takes 10 ms

    try:
        found = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return found["value"] if len(found) == 1 else text


def normal_name(name: str) -> str:
    """Return `safety.takeoff` for `/safety/takeoff` (ROS) or `/state_safety_node/takeoff` (lab)."""
    node, dot, rest = name.strip("/").replace("/", ".").partition(".")
    return f"{LAB_NODES.get(node, node)}{dot}{rest}"


def put(table: dict[str, Any], name: str, value: Any, source: str) -> None:
    """Set a value in nested tables by dotted name; a table changes only the values it names."""
    if isinstance(value, dict):
        for part, inner in value.items():
            put(table, f"{name}.{part}", inner, source)
        return
    *path, last = normal_name(name).split(".")
    for depth, part in enumerate(path, 1):
        found: Any = table.setdefault(part, {})
        if not isinstance(found, dict):
            whole = ".".join(path[:depth])
            raise Invalid(f"{source}: {whole} is a value and has no {last}", f"set {whole} itself")
        table = found
    if isinstance(parts := table.get(last), dict) and parts:
        whole = ".".join((*path, last))
        raise Invalid(
            f"{source}: {whole}: expected `object`, with {', '.join(parts)} as before, got a value",
            "leave out one of the two, or set its parts",
        )
    table[last] = value


def flatten(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every leaf of nested tables with its dotted name; of sequences, lists."""
    for key, value in table.items():
        name = f"{prefix}.{key}" if prefix else key
        if isinstance(value, Mapping) and value:
            yield from flatten(value, name)
        else:
            yield name, _listed(value)


def _listed(value: Any) -> Any:
    """Return a value as TOML and the wire have it, without tuples."""
    if isinstance(value, list | tuple):
        return [_listed(part) for part in value]
    return (
        {name: _listed(part) for name, part in value.items()} if isinstance(value, dict) else value
    )


def nearest(name: str, names: Iterable[str]) -> str:
    """Return a hint with the most similar name, or an empty text."""
    import difflib

    folded = {known.lower(): known for known in names}
    found = difflib.get_close_matches(name.lower(), folded, n=1)
    return f"did you mean {folded[found[0]]}?" if found else ""
