"""Values as TOML writes them, in files and on command lines. Pure."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from services.runtime.settings.named import put, value_of

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def value(said: Any) -> str:
    """A value as it stands right of a `=` in a file."""
    if isinstance(said, bool):
        return str(said).lower()
    if isinstance(said, Mapping):
        pairs = ", ".join(f"{_key(name)} = {value(part)}" for name, part in said.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(said, list | tuple):
        return f"[{', '.join(map(value, said))}]"
    if isinstance(said, str):
        import json

        # JSON's escapes are TOML's as well; of the control characters it leaves DEL alone.
        return json.dumps(said, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(said)


def word(said: Any) -> str:
    """A value as `param get` prints it and `param set` takes it: text as it is where that is clear."""
    if isinstance(said, str) and said and said.isprintable() and said.strip() == said:
        # A text that begins as a table or list would be read as one, in another notation.
        plain = value_of(said) == said and said[0] not in "{["
        return said if plain else value(said)
    return value(said)


def document(values: Mapping[str, Any]) -> str:
    """A file that sets values by dotted name, a table after the one that it stands in."""
    tables: dict[str, Any] = {}
    for name, part in values.items():
        put(tables, name, part, "the file")
    return "\n\n".join("\n".join(lines) for lines in _tables(tables, "")) + "\n"


def _tables(table: Mapping[str, Any], path: str) -> Iterator[list[str]]:
    values = {name: part for name, part in table.items() if not isinstance(part, Mapping)}
    if values:
        head = [f"[{path}]"] if path else []
        yield [*head, *(f"{_key(name)} = {value(part)}" for name, part in values.items())]
    for name, part in table.items():
        if isinstance(part, Mapping):
            yield from _tables(part, f"{path}.{_key(name)}".lstrip("."))


def _key(name: str) -> str:
    return name if _BARE_KEY.fullmatch(name) else value(name)
