"""Declarations of a command's words, for both the fast parser and Typer.

    def goto(options: Options, x: Annotated[float, Arg("East, m.")],
             replace: Annotated[bool, Option("Change course.")] = False) -> None:

The docstring is the help, its `Example:` line included.
"""

from collections.abc import Callable
from typing import Any, Literal

from msgspec import Struct

Names = Literal["", "topic", "service", "node", "param", "setting", "type", "field", "vehicle"]
"""Kinds of shell completion; `field` is a field of the service or topic in the word before."""


class Arg(Struct, frozen=True):
    """Positional word; a `list[str]` takes all that are left."""

    about: str
    metavar: str = ""
    complete: Names = ""


class Option(Struct, frozen=True):
    """Named word; without `names` its name is that of the function's parameter."""

    about: str
    names: tuple[str, ...] = ()
    metavar: str = ""
    min: int | None = None
    complete: Names = ""


class Parameter(Struct, frozen=True):
    """Declared word in the form that both parsers use."""

    name: str
    type: type
    many: bool
    default: Any
    required: bool
    declaration: Arg | Option

    @property
    def is_option(self) -> bool:
        """Return whether it is named, not positional."""
        return isinstance(self.declaration, Option)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the spellings of an option."""
        own = f"--{self.name.replace('_', '-')}"
        return (isinstance(self.declaration, Option) and self.declaration.names) or (own,)


class ParsedCommand(Struct, frozen=True):
    """Parsed line: the function to run, the common options, and the command's own values."""

    command: Callable[..., None]
    common: dict[str, Any]
    values: dict[str, Any]


def words_of(command: Callable[..., None]) -> list[Parameter]:
    """Return the words that a command declares, in order."""
    annotations = {
        name: annotation
        for name, annotation in command.__annotations__.items()
        if name not in {"options", "return"}
    }
    defaults = dict(zip(reversed(annotations), reversed(command.__defaults__ or ()), strict=False))
    return [
        _word(name, annotation, name not in defaults, defaults.get(name))
        for name, annotation in annotations.items()
    ]


def takes_signed(words: list[Parameter]) -> bool:
    """Return whether `-1` can be a positional word, and so no option."""
    return any(not w.is_option and (w.type is float or w.many) for w in words)


def is_number(text: str) -> bool:
    """Return whether Python reads a text as a number; it also reads `1_0` as ten."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _word(name: str, annotation: Any, required: bool, default: Any) -> Parameter:
    type_, declaration = annotation.__origin__, annotation.__metadata__[0]
    # `float | None` counts as float.
    type_ = next(iter(getattr(type_, "__args__", ())), type_) if not _is_list(type_) else type_
    many = _is_list(type_)
    item = type_.__args__[0] if many else type_
    return Parameter(name, item, many, default, required, declaration)


def _is_list(type_: Any) -> bool:
    return getattr(type_, "__origin__", None) is list
