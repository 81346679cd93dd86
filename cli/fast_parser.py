"""Parser of well-formed lines, without Typer.

Importing Typer costs three times the processor time of a whole command. An unknown option, a
missing word or `--help` is left to Typer, which reads the same declarations and explains the error.
"""

from collections.abc import Iterator
from typing import Any

from quadctl.cli import commands
from quadctl.cli.context import COMMON
from quadctl.cli.declarations import (
    Parameter,
    ParsedCommand,
    is_number,
    takes_signed,
    words_of,
)
from quadctl.services.runtime.errors import UsageError

_ENDINGS = {"--record": ".mcap"}
"""Ending of a word that makes it the value of the option before it, by option."""


def given(words: list[str]) -> list[str]:
    """Return the line with `--record` as `--record=`, `--record x.mcap` as `--record=x.mcap`."""
    line: list[str] = []
    for word in words:
        before = line[-1] if line else ""
        if before.endswith("=") and word.endswith(_ENDINGS.get(before[:-1], "\0")):
            line[-1] += word
        else:
            line.append(f"{word}=" if word in _ENDINGS else word)
    return line


class _Declined(Exception):
    """Refusal of a line that Typer has to read."""


def read(words: list[str]) -> ParsedCommand | None:
    """Return a parsed line, or None to leave it to Typer."""
    common: dict[str, Any] = {}
    try:
        path, rest = commands.split(_after_common(words, common))
        if not path:
            return None
        command = commands.command(path)
        declared = words_of(command)
        values = _read(declared, iter(rest), common)
        return ParsedCommand(command, common, _completed(declared, values))
    except (_Declined, ValueError):
        return None


def _after_common(words: list[str], common: dict[str, Any]) -> list[str]:
    """Take the common options before the command, and return the rest."""
    line = iter(words)
    for word in line:
        if not word.startswith("-"):
            return [word, *line]
        if not _take_common(word, line, common):
            raise _Declined
    return []


def _read(declared: list[Parameter], line: Iterator[str], common: dict[str, Any]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    named = {name: word for word in declared if word.is_option for name in word.names}
    placed = iter(word for word in declared if not word.is_option)
    signed, place = takes_signed(declared), None
    for text in line:
        # `-inf` may be a number, or the options -i, -n and -f in one.
        if text.startswith("-") and not (signed and is_number(text) and not text[1].isalpha()):
            name, equals, value = text.partition("=")
            if equals and not text.startswith("--"):
                raise _Declined  # a short option's value would begin with the =
            if name in named:
                _take(named[name], (value if equals else None), line, values)
            elif not _take_common(text, line, common):
                raise _Declined
            continue
        if place is None or not place.many:
            place = next(placed, None)
        if place is None:
            raise _Declined
        _put(place, text, values)
    return values


def _take(word: Parameter, value: str | None, line: Iterator[str], values: dict[str, Any]) -> None:
    if word.type is bool:
        if value is not None:
            raise _Declined
        values[word.name] = True
    else:
        _put(word, _value(line) if value is None else value, values)


def _put(word: Parameter, text: str, values: dict[str, Any]) -> None:
    if not isinstance(word.type, type):
        raise _Declined  # a tuple of several words
    if word.type in {int, float} and "_" in text and is_number(text):
        # Python reads 1_0 as ten.
        raise UsageError(f"'{text}' is not a number", "write it without the _")
    value = word.type(text)
    if (least := getattr(word.declaration, "min", None)) is not None and value < least:
        raise _Declined
    if word.many:
        values.setdefault(word.name, []).append(value)
    else:
        values[word.name] = value


def _take_common(text: str, line: Iterator[str], common: dict[str, Any]) -> bool:
    name, equals, value = text.removeprefix("--").partition("=")
    if not text.startswith("--") or name not in COMMON:
        return False
    type_, _ = COMMON[name]
    if type_ is bool:
        if equals:
            return False
        common[name] = True
    else:
        common[name] = type_(value if equals else _value(line))
    return True


def _value(line: Iterator[str]) -> str:
    value = next(line, "-")
    if value.startswith("-") and not is_number(value):
        raise _Declined
    return value


def _completed(declared: list[Parameter], values: dict[str, Any]) -> dict[str, Any]:
    for word in declared:
        if word.name not in values:
            if word.required:
                raise _Declined
            values[word.name] = word.default
    return values
