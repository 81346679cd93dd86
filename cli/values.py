"""Values as typed on a command line: `name=value`, JSON, YAML, or in order."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from quadctl.schemas.typed import converted
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.nesting import TOO_DEEP, is_too_deep
from quadctl.services.runtime.params.names import put, value_of

M = TypeVar("M", bound=Struct)

_NAMED = r"[A-Za-z_]\w*:(\s.*)?"
_ROS_TYPE = r"\w+(_(msgs|srvs|interfaces)/(msg/|srv/)?|/(msg|srv)/)[A-Z]\w*"
_LINE = r"\s*([A-Za-z_]\w*):[ \t]+([^\s\[\]{}'\"|>&*!#].*)"
"""One line, `name: text`, with no character of special meaning in YAML before the text."""
_DEEPEST = 50
"""Levels of nested lists and tables in YAML."""


def message_of(type_: type[M], name: str, words: list[str]) -> M:
    """Read the words as a message of a type, `name` to `quadctl type show`; raise Invalid."""
    try:
        return converted(_table(type_, name, without_type(words, type_.__name__)), type_)
    except msgspec.ValidationError as error:
        hint = f"`quadctl type show {name}` prints the fields"
        raise Invalid(f"not a valid {type_.__name__}: {error}", hint) from error


def table_of(words: list[str]) -> Any:
    """Read the words as plain data: JSON, YAML, `key=value` (dots make tables), or one value."""
    if is_data(words):
        return _data(words[0])
    if is_pairs(words):
        return _pairs(words)
    return value_of(words[0]) if len(words) == 1 else [value_of(word) for word in words]


def parameter(text: str) -> Any:
    """Read a parameter's value: TOML's notation, a table or list in JSON or YAML, else a word."""
    found = value_of(text)
    if found != text or not _is_flow(text):
        return found
    # A text for a user's own node may begin like a table, too: leave the check to the node.
    with suppress(Invalid):
        return _flow(text)
    return text


def is_data(words: list[str]) -> bool:
    """Return whether the words are one table or list, in one argument."""
    return len(words) == 1 and (_is_flow(words[0]) or _is_block(words[0]))


def is_pairs(words: list[str]) -> bool:
    """Return whether the words are `key=value`."""
    return bool(words) and all("=" in word.lstrip("=") for word in words)


def without_type(words: list[str], own: str = "") -> list[str]:
    """Drop a leading type, as `rostopic pub` takes one: the topic's name implies it."""
    return words[1:] if len(words) > 1 and is_type(words[0], own) else words


def is_type(word: str, own: str = "") -> bool:
    """Return whether a word is a ROS type, or the topic's `own` with or without a package."""
    name = word.rpartition("/")[2]
    return bool((own and name == own) or ("/" in word and _matches(_ROS_TYPE, word)))


def _matches(pattern: str, text: str) -> bool:
    import re  # takes 6 ms, and most values need none

    return re.fullmatch(pattern, text) is not None


def _is_flow(text: str) -> bool:
    return text.lstrip()[:1] in {"{", "["}


def _is_block(text: str) -> bool:
    """Return whether a text has only `name: value` lines, indented lines and `- ` items."""
    if ":" not in text:
        return False
    first, *more = [line for line in text.splitlines() if line.strip()] or [""]
    return _matches(_NAMED, first.lstrip()) and all(
        line[0].isspace() or line.startswith("- ") or _matches(_NAMED, line) for line in more
    )


def _table(type_: type[Struct], name: str, words: list[str]) -> Any:
    names = type_.__struct_fields__
    if is_data(words) and not words[0].lstrip().startswith("["):
        return _data(words[0])
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


def _data(text: str) -> Any:
    if _is_flow(text):
        return _flow(text)
    try:
        return _yaml(text)
    except Invalid as problem:
        # Users type `data: hello: there` for rostopic, where YAML wants quotes.
        import re

        if line := re.fullmatch(_LINE, text.rstrip()):
            return {line[1]: value_of(line[2])}
        hint = "quote a text with a colon, write name=value words, or `--as text` for your own key"
        raise Invalid(f"the argument is not YAML: {problem.message}", hint) from problem


def _flow(text: str) -> Any:
    try:
        value = msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        try:
            return _yaml(text)
        except Invalid as problem:
            raise Invalid(
                f"the argument is not JSON: {error}; nor YAML: {problem.message}",
                "write name=value words, or one '{\"name\": value}'",
            ) from error
    if is_too_deep(value):
        raise Invalid(f"the argument is {TOO_DEEP}")
    return value


def _yaml(text: str) -> Any:
    """Read YAML with bare words as in `name=value`; raise Invalid.

    PyYAML's own readers follow YAML 1.1: `on` and `no` are truth values, `1e3` is a text and 1:30
    is 90. Aliases (a few words can take exponential memory) and tags are refused.
    """
    import yaml

    try:
        events = yaml.parse(text, yaml.SafeLoader)
        next(events)  # the stream's start
        next(events)  # the document's start
        found = _node(events, next(events))
        next(events)  # the document's end
        if not isinstance(end := next(events), yaml.StreamEndEvent):
            raise Invalid(f"there is more than one document{_at(end.start_mark)}")
    except yaml.MarkedYAMLError as error:
        raise Invalid(f"{error.problem}{_at(error.problem_mark)}") from error
    except yaml.reader.ReaderError as error:
        raise Invalid(f"{error.reason}, at {error.position + 1}") from error
    return found


def _node(events: Iterator[Any], event: Any, depth: int = 0) -> Any:
    """Build one value from its events; `event` is the first."""
    import yaml

    if depth > _DEEPEST:
        raise Invalid(f"it is nested deeper than {_DEEPEST} levels")
    if isinstance(event, yaml.AliasEvent) or event.anchor or event.tag:
        raise Invalid(f"anchors, aliases and tags are not accepted{_at(event.start_mark)}")
    if isinstance(event, yaml.ScalarEvent):
        return _text(event) if event.style else _bare(event.value)
    if isinstance(event, yaml.SequenceStartEvent):
        items: list[Any] = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            items.append(_node(events, event, depth + 1))
        return items
    table: dict[str, Any] = {}
    while not isinstance(name := next(events), yaml.MappingEndEvent):
        if not isinstance(name, yaml.ScalarEvent) or name.anchor or name.tag:
            raise Invalid(f"a name must be a word or a quoted text{_at(name.start_mark)}")
        found = next(events)
        if _is_glued(name, found):
            own, _, word = name.value.partition(":")
            if word.startswith(("'", '"')):
                raise Invalid(f"{name.value!r} has no blank after its colon{_at(name.start_mark)}")
            table[own] = _bare(word)
        else:
            table[_text(name)] = _node(events, found, depth + 1)
    return table


def _text(event: Any) -> str:
    """Return the text of a scalar; raise Invalid if UTF-8 cannot encode it."""
    text: str = event.value
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise Invalid(f"a \\u escape is half a character{_at(event.start_mark)}") from error
    return text


def _is_glued(name: Any, found: Any) -> bool:
    """Return whether a name and its value are one word, `{x:1}`: a name alone in YAML."""
    alone = name.end_mark.index == found.start_mark.index
    return alone and not name.style and ":" in name.value


def _bare(word: str) -> Any:
    return None if word in {"", "~", "null"} else value_of(word)


def _at(mark: Any) -> str:
    return f", line {mark.line + 1}, column {mark.column + 1}"
