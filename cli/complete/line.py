"""Which word of an unfinished line is being completed, and with what."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from cli import table
from cli.complete import live
from cli.declare import Arg, Names, Opt, Word, takes_signed, words_of
from cli.options import COMMON, Options, options_of

_COMMON = {f"--{name}": (type_, about) for name, (type_, about) in COMMON.items()}
_FIRST = {
    "--version": "Print the version and exit.",
    "--install-completion": "Install completion for this shell.",
    "--show-completion": "Print the completion script of this shell.",
}


class Found(NamedTuple):
    """A word that fits, and what it means where that is known."""

    word: str
    about: str = ""


def candidates(before: list[str], begun: str, *, explain: bool = True) -> list[Found]:
    """The words that fit after those `before` the one that has been `begun`.

    To `explain` commands, each is loaded, which takes its time.
    """
    fitting = _fitting(before, begun, explain=explain)
    found = sorted({fit for fit in fitting if fit.word.startswith(begun)})
    return list({fit.word: fit for fit in found}.values())


def _fitting(before: list[str], begun: str, *, explain: bool) -> Iterable[Found]:
    common: dict[str, str] = {}
    path, rest = "", iter(before)
    for text in rest:
        if text.startswith("-"):
            if _takes_value(text) and _value(text, rest, common) is None:
                return _of_common(text, begun, common)
        elif (path := f"{path} {text}".lstrip()) in table.COMMANDS:
            return _of_command(path, list(rest), begun, common)
    if begun.startswith("-"):
        return _options([], at_first=not path)
    return _commands(path, explain=explain)


def _commands(group: str, *, explain: bool) -> Iterator[Found]:
    if not group:
        yield from (Found(name, about) for name, about in table.GROUPS.items())
    for path in table.COMMANDS:
        parent, _, name = path.rpartition(" ")
        if parent == group and path not in table.ALIASES:
            about = table.command(path).__doc__ if explain else ""
            yield Found(name, (about or "").partition("\n")[0])


def _of_command(path: str, rest: list[str], begun: str, common: dict[str, str]) -> Iterable[Found]:
    declared = words_of(table.command(path))
    named = {name: word for word in declared if isinstance(word.said, Opt) for name in word.names}
    placed = [word for word in declared if isinstance(word.said, Arg)]
    said: list[tuple[Word, str]] = []
    line = iter(rest)
    for text in line:
        option = text.partition("=")[0]
        if option in named:
            if named[option].type is not bool and "=" not in text and next(line, None) is None:
                return _words(named[option], begun, common, said)
        elif _takes_value(text):
            if _value(text, line, common) is None:
                return _of_common(text, begun, common)
        elif not text.startswith("-") or takes_signed(declared):
            said.append((placed[0], text) if placed else (declared[0], text))
            placed = placed if placed and placed[0].many else placed[1:]
    if begun.startswith("-"):
        option, equals, value = begun.partition("=")
        if not equals:
            return _options(declared)
        if option not in named:
            return []
        found = _words(named[option], value, common, said)
        return [Found(f"{option}={fit.word}", fit.about) for fit in found]
    return _words(placed[0], begun, common, said) if placed else []


def _words(
    word: Word, begun: str, common: dict[str, str], said: list[tuple[Word, str]]
) -> Iterable[Found]:
    """What a declared word can be: a file, or one of the names that it says."""
    if word.type is Path:
        return map(Found, _files(begun))
    subject = next((text for other, text in said if other.said.complete in live.SUBJECTS), "")
    names = live.names(word.said.complete, _reach(common), begun, subject)
    if word.said.complete == "field":
        given = {text.partition("=")[0] for _, text in said}
        names = (name for name in names if name.removesuffix("=") not in given)
    return map(Found, names)


def _of_common(option: str, begun: str, common: dict[str, str]) -> Iterable[Found]:
    """What the value of a common option can be: a live vehicle."""
    kind: Names = "vehicle" if option == "--vehicle" else ""
    return map(Found, live.names(kind, _reach(common), begun, ""))


def _reach(common: dict[str, str]) -> Options:
    """The options that say where to look; a shell's patience is its own."""
    return options_of({k: v for k, v in common.items() if k != "timeout"})


def _files(begun: str) -> Iterator[str]:
    folder = begun[: begun.rfind("/") + 1]
    try:
        with os.scandir(Path(folder).expanduser()) as entries:
            for entry in entries:
                if not entry.name.startswith("."):
                    yield f"{folder}{entry.name}{'/' if entry.is_dir() else ''}"
    except OSError:
        return


def _options(declared: list[Word], *, at_first: bool = False) -> Iterator[Found]:
    for word in declared:
        if isinstance(word.said, Opt):
            for name in word.names:
                yield Found(name, word.said.about)
    for name, (_, about) in _COMMON.items():
        yield Found(name, about)
    yield Found("--help", "Show what this does, and exit.")
    if at_first:
        yield from map(Found._make, _FIRST.items())


def _takes_value(text: str) -> bool:
    known = _COMMON.get(text.partition("=")[0])
    return known is not None and known[0] is not bool


def _value(text: str, line: Iterator[str], common: dict[str, Any]) -> str | None:
    """The value of a common option, taken from the line; None where the line ends first."""
    name, equals, value = text.partition("=")
    taken = value if equals else next(line, None)
    if taken is not None:
        common[name.removeprefix("--")] = taken
    return taken
