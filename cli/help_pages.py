"""Help pages, from the declarations of the commands."""

import os
import sys
from collections.abc import Iterable, Iterator

from quadctl.cli import commands
from quadctl.cli.declarations import Parameter

ABOUT = "Fly the quadrotor lab: separate processes over Zenoh, a safety cage, two services."
EXITS = (
    "Exit codes: 0 done, 1 unexpected error, 2 usage, 3 no answer, 4 timeout, 5 refused by"
    " safety, 6 invalid parameter, message or schema, 7 already served, 8 fault found, 130 Ctrl-C."
)
_NARROWEST = 50
"""Columns: a narrower terminal breaks the lines itself."""
_WIDEST = 30
"""Columns of a name that has its meaning beside it."""

Row = tuple[str, str]


def page(path: str) -> str:
    """Return the page of a command or group, or without a path of all commands."""
    # Piped output has one line per item.
    width = max(os.get_terminal_size().columns, _NARROWEST) if sys.stdout.isatty() else 0
    return "\n".join(_filled(first, text, width) for first, text in _lines(path))


def _filled(first: str, text: str, width: int) -> str:
    """Return a line, broken at a width if there is one; more lines begin below the text."""
    if not width:
        return first + text
    from textwrap import fill

    return fill(text, width, initial_indent=first, subsequent_indent=" " * len(first))


def _lines(path: str) -> Iterator[Row]:
    words, is_command = commands.words_at(path), path in commands.COMMANDS
    placed = [word for word in words if not word.is_option]
    usage = [*map(_in_usage, placed)] if is_command else ["COMMAND [ARGS]..."]
    yield f"Usage: {f'quadctl {path}'.rstrip()} ", " ".join(["[OPTIONS]", *usage])
    about = commands.command(path).__doc__ if is_command else commands.GROUPS.get(path, ABOUT)
    for paragraph in (about or "").split("\n\n"):
        yield from (("", ""), ("  ", " ".join(paragraph.split())))
    yield from _section("Arguments", ((word.placeholder, _explained(word)) for word in placed))
    options = (word for word in words if word.is_option)
    yield from _section("Options", ((_spelled(word), _explained(word)) for word in options))
    if not is_command:
        inner = commands.inside(path).items()
        shown = (item for item in inner if item[1] not in commands.ALIASES)
        yield from _section("Commands", ((name, commands.meaning(each)) for name, each in shown))
    if not path:
        yield from (("", ""), ("  ", EXITS))


def _section(title: str, rows: Iterable[Row]) -> Iterator[Row]:
    found = list(rows)
    if found:
        column = min(max(len(name) for name, _ in found), _WIDEST)
        yield from (("", ""), ("", f"{title}:"))
        for name, about in found:
            if len(name) > column:
                yield "", f"  {name}"
            yield f"  {name if len(name) <= column else '':{column}}  ", about


def _in_usage(word: Parameter) -> str:
    if word.required:
        return f"{{{word.placeholder}}}"
    return word.placeholder if word.placeholder.startswith("[") else f"[{word.placeholder}]"


def _spelled(word: Parameter) -> str:
    names = ", ".join(sorted(word.names, key=len))
    if word.type is bool:
        return names
    return f"{names} {word.declaration.metavar or f'<{word.type.__name__.lower()}>'}"


def _explained(word: Parameter) -> str:
    least = getattr(word.declaration, "min", None)
    facts = [f"default: {word.shown_default}"] if word.shown_default else []
    facts += [f"x>={least}"] if least is not None else []
    facts += ["required"] if word.required else []
    return word.declaration.about + (f"  [{'; '.join(facts)}]" if facts else "")
