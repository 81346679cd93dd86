"""A request or message as written on a command line: `key=value`, JSON, or values in order."""

import re
from contextlib import suppress
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from services.runtime.errors import Invalid
from services.runtime.params.names import put, value_of

M = TypeVar("M", bound=Struct)

_NAMED = r"[A-Za-z_]\w*:(\s|$)"
_ROS_TYPE = r"\w+(_(msgs|srvs|interfaces)/(msg/|srv/)?|/(msg|srv)/)[A-Z]\w*"


def message_of(type_: type[M], name: str, words: list[str]) -> M:
    """Read the words as a message of a type; raises Invalid, telling the fields.

    `name` is what `quadctl type show` knows the type by.
    """
    try:
        return msgspec.convert(_table(type_, name, without_type(words, type_.__name__)), type_)
    except msgspec.ValidationError as error:
        raise Invalid(
            f"not a valid {type_.__name__}: {error}",
            f"`quadctl type show {name}` prints the fields",
        ) from error


def table_of(words: list[str]) -> Any:
    """Read the words as plain data: JSON, `key=value` (dots make tables), or one value."""
    if is_data(words):
        return _data(words[0])
    if is_pairs(words):
        return _pairs(words)
    return value(words[0]) if len(words) == 1 else [value(word) for word in words]


def is_data(words: list[str]) -> bool:
    """Whether the words are one table or list, in one argument."""
    return len(words) == 1 and (_is_flow(words[0]) or _is_block(words[0]))


def _is_flow(text: str) -> bool:
    return text.lstrip()[:1] in {"{", "["}


def _is_block(text: str) -> bool:
    """Whether a text is `name: value` lines; what is between is indented, or an item with a dash."""
    first, *more = [line for line in text.splitlines() if line.strip()] or [""]
    return bool(re.match(_NAMED, first.lstrip())) and all(
        line[0].isspace() or line.startswith("- ") or re.match(_NAMED, line) for line in more
    )


def is_pairs(words: list[str]) -> bool:
    """Whether the words are `key=value`."""
    return bool(words) and all("=" in word.lstrip("=") for word in words)


def without_type(words: list[str], own: str = "") -> list[str]:
    """Leave out a type that comes first, as `rostopic pub` has it: it is known by the name."""
    return words[1:] if len(words) > 1 and is_type(words[0], own) else words


def is_type(word: str, own: str = "") -> bool:
    """Whether a word is a type as in ROS, or the topic's `own` with or without a package."""
    name = word.rpartition("/")[2]
    return bool((own and name == own) or re.fullmatch(_ROS_TYPE, word))


def value(word: str) -> Any:
    """One value as written on a command line: a number, also as `.5`, or what TOML makes of it."""
    if word.isascii() and "_" not in word:
        for number in (int, float):
            # Without the TOML reader, whose import takes longer than publishing does.
            with suppress(ValueError):
                return number(word)
    return value_of(word)


def _table(type_: type[Struct], name: str, words: list[str]) -> Any:
    names = type_.__struct_fields__
    if is_data(words) and not words[0].lstrip().startswith("["):
        return _data(words[0])
    if all("=" in word for word in words):
        return _pairs(words)
    if len(words) > len(names):
        raise Invalid(f"{name} takes {len(names)} values", f"the fields are: {names}")
    return {field: value(word) for field, word in zip(names, words, strict=False)}


def _pairs(words: list[str]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for word in words:
        name, _, text = word.partition("=")
        put(table, name, value(text), word)
    return table


def _data(text: str) -> Any:
    """One argument that is a table or a list: JSON, or as ROS users write it, `{x: 1}`, `x: 1`."""
    if not _is_flow(text):
        return _lines(text)
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        from cli import flow

        try:
            return flow.read(text)
        except Invalid as problem:
            raise Invalid(
                f"the argument is not JSON: {error}; nor as in ROS: {problem.message}",
                "write name=value words, or one '{\"name\": value}'",
            ) from error


def _lines(text: str) -> Any:
    from cli import block

    try:
        return block.read(text)
    except Invalid as problem:
        raise Invalid(
            f"the argument is no lines of name: value: {problem.message}",
            "write name=value words, or `--as text` to a key of your own",
        ) from problem
