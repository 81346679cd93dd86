"""A request or message as written on a command line: `key=value`, JSON, or values in order."""

from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from services.runtime.errors import Invalid
from services.runtime.params import put, value_of

M = TypeVar("M", bound=Struct)


def message_of(type_: type[M], name: str, words: list[str]) -> M:
    """Read the words as a message of a type; raises Invalid, telling the fields.

    `name` is what `quadctl type show` knows the type by.
    """
    try:
        return msgspec.convert(_table(type_, name, words), type_)
    except msgspec.ValidationError as error:
        raise Invalid(
            f"not a valid {type_.__name__}: {error}",
            f"`quadctl type show {name}` prints the fields",
        ) from error


def table_of(words: list[str]) -> Any:
    """Read the words as plain data: JSON, `key=value` (dots make tables), or one value."""
    if len(words) == 1 and words[0][:1] in {"{", "["}:
        return _json(words[0])
    if words and all("=" in word for word in words):
        return _pairs(words)
    return value_of(words[0]) if len(words) == 1 else [value_of(word) for word in words]


def _table(type_: type[Struct], name: str, words: list[str]) -> Any:
    names = type_.__struct_fields__
    if len(words) == 1 and words[0].startswith("{"):
        return _json(words[0])
    if all("=" in word for word in words):
        return _pairs(words)
    if len(words) > len(names):
        raise Invalid(f"{name} takes {len(names)} values", f"the fields are: {names}")
    return {field: value_of(word) for field, word in zip(names, words, strict=False)}


def _pairs(words: list[str]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for word in words:
        name, _, text = word.partition("=")
        put(table, name, value_of(text), word)
    return table


def _json(text: str) -> Any:
    try:
        return msgspec.json.decode(text)
    except msgspec.DecodeError as error:
        raise Invalid(f"the argument is not JSON: {error}", '{"zero": true}') from error
