"""Declarations of a command's words, for the parser, the help pages and completion.

    def goto(options: Options, x: Annotated[float, Arg("East, m.")],
             replace: Annotated[bool, Option("Change course.")] = False) -> None:

The docstring is the help, its `Example:` line included.
"""

from collections.abc import Callable
from types import UnionType
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
    """Named word; without `names` its name is that of the function's parameter.

    With an `ending`, e.g. `.toml`, the value may be left out before a word that does not end so.
    """

    about: str
    names: tuple[str, ...] = ()
    metavar: str = ""
    min: int | None = None
    complete: Names = ""
    ending: str = ""


class Parameter(Struct, frozen=True):
    """Declared word; `many` collects every value, `count` is the number of words of one."""

    name: str
    type: type
    declaration: Arg | Option
    default: Any = None
    required: bool = False
    many: bool = False
    count: int = 1

    @property
    def is_option(self) -> bool:
        """Return whether it is named, not positional."""
        return isinstance(self.declaration, Option)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the spellings of an option."""
        own = f"--{self.name.replace('_', '-')}"
        return (isinstance(self.declaration, Option) and self.declaration.names) or (own,)

    @property
    def placeholder(self) -> str:
        """Return the name of a value in texts."""
        return self.declaration.metavar or self.name.upper()

    @property
    def shown_default(self) -> str:
        """Return the default as texts show it; empty if there is none, or it goes without saying."""
        return "" if self.type is bool or self.default is None else str(self.default)

    def is_left_out(self, line: list[str]) -> bool:
        """Return whether a line goes on without the value, which may be left out."""
        ending = getattr(self.declaration, "ending", "")
        return bool(ending) and not (line and line[0].endswith(ending))


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
    if isinstance(type_, UnionType):  # `float | None` counts as float
        type_ = type_.__args__[0]
    items = getattr(type_, "__args__", (type_,))
    many = getattr(type_, "__origin__", None) is list
    return Parameter(name, items[0], declaration, default, required, many, len(items))
