"""Completions of an unfinished line, live names among them."""

import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from quadctl.cli import commands, context, names as known
from quadctl.cli.context import COMMON, Options, options_of
from quadctl.cli.declarations import Names, Parameter, takes_signed, words_of
from quadctl.parameters import RunningParams
from quadctl.schemas.keyexpr import EndpointInfo
from quadctl.schemas.params import Params
from quadctl.schemas.topics import SERVICES, TOPICS
from quadctl.services.runtime.bus.client import Client
from quadctl.services.runtime.errors import QuadctlError, UsageError
from quadctl.services.runtime.params.names import flatten

_PARAMETERS = ("GetParams", "SetParams")


def topic(key: str, begun: str, vehicle: str) -> Iterator[str]:
    """Spell our topics by name or key, others by key: their names would be read as keys."""
    name = key.removeprefix(f"{vehicle}/")
    ours = name != key and any(name == topic.name for topic in TOPICS)
    return _spellings(key, name if ours else "", begun)


def service(offer: EndpointInfo, begun: str, vehicle: str) -> Iterator[str]:
    """Spell a service by its name, its full key, or, if it is ours, as in ROS: `/uav/goto`."""
    own, _, rest = offer.key.partition("/")
    key, named = offer.key, rest == f"@srv/{offer.name}"
    ours = offer.type in _PARAMETERS or any(offer.name == known.name for known in SERVICES)
    if named and ours and begun.startswith("/") and "@" not in begun:
        key = f"{own}/{offer.name}"
    return _spellings(key, offer.name if named and own == vehicle else "", begun)


def node(name: str, begun: str, vehicle: str) -> Iterator[str]:
    """Spell a node by its name, also behind its vehicle's."""
    return _spellings(f"{vehicle}/{name}", name, begun)


def parameter(name: str, begun: str, vehicle: str) -> Iterator[str]:
    """Spell a parameter with dots or slashes, also behind its vehicle's name."""
    between = "/" if "/" in begun else "."
    name = name.replace(".", between)
    return _spellings(f"{vehicle}{between}{name}", name, begun)


def setting(name: str, begun: str) -> Iterator[str]:
    """Spell a parameter of the file, which has no vehicle."""
    slash = "/" if begun.startswith("/") else ""
    yield f"{slash}{name.replace('.', '/' if '/' in begun else '.')}"


def _spellings(key: str, name: str, begun: str) -> Iterator[str]:
    """Yield the name, if any; the key only without a name, or once a word has been begun."""
    slash = "/" if begun.startswith("/") else ""
    if name:
        yield f"{slash}{name}"
    if not name or begun.strip("/"):
        yield f"{slash}{key}"


SUBJECTS = ("topic", "service")  # kinds of names that have fields
_ALL = "*"
_PATIENCE = 0.1  # s to wait for live names: a shell that waits longer seems stuck


def names(kind: Names, options: Options, begun: str, subject: str) -> Iterable[str]:
    """Return the names of a kind, spelled as begun: name or full key, with or without a slash.

    The kind `field` takes the fields of the subject, a topic or service.
    """
    try:
        return list(_names(kind, options, begun, subject))
    except (QuadctlError, OSError):
        # No hub, or no such name: a shell has no place to show an error.
        return []


def _names(kind: Names, options: Options, begun: str, subject: str) -> Iterable[str]:
    if not kind:
        return []
    if kind == "setting":
        settings = (name for name, _ in flatten(msgspec.to_builtins(Params())))
        return [f"{spelling}=" for name in settings for spelling in setting(name, begun)]
    if kind == "field":
        vehicle = context.about_topic(options, subject).named or _vehicle(options)
        return [f"{field}=" for field in known.fields_of(subject, vehicle)]
    if kind == "type":
        return known.types()
    until = time.monotonic() + _PATIENCE
    vehicle = _vehicle(options)
    with Client(options.realm, vehicle, connect=options.connect, timeout=_PATIENCE) as client:
        return list(_live(kind, client, begun, until))


def _vehicle(options: Options) -> str:
    """Return the selected vehicle, or the pattern of all if there are several."""
    try:
        return options.vehicle
    except UsageError:
        return _ALL


def _live(kind: Names, client: Client, begun: str, until: float) -> Iterator[str]:
    vehicle = client.vehicle
    if kind == "node":
        for name in sorted({*client.nodes()}):
            yield from node(name, begun, vehicle)
    elif kind == "vehicle":
        yield from client.vehicles()
    elif kind == "param":
        for name in RunningParams(client, until).answered():
            yield from parameter(name, begun, vehicle)
    elif kind == "service":
        for offer in client.endpoints("@srv"):
            yield from service(offer, begun, vehicle)
    else:
        for key in {offer.key for offer in client.endpoints("@pub", "@sub")}:
            yield from topic(key, begun, vehicle)


class Found(NamedTuple):
    """Word that fits, and its meaning if known."""

    word: str
    about: str = ""


def candidates(before: list[str], begun: str, *, explain: bool = True) -> list[Found]:
    """Return the completions of `begun` after `before`; to `explain`, load each command (slow)."""
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
        elif (path := f"{path} {text}".lstrip()) in commands.COMMANDS:
            return _of_command(path, list(rest), begun, common)
    if begun.startswith("-"):
        return _options(path)
    return _commands(path, explain=explain)


def _commands(group: str, *, explain: bool) -> Iterator[Found]:
    for name, path in commands.inside(group).items():
        if path not in commands.ALIASES:
            yield Found(name, commands.meaning(path) if explain else "")


def _of_command(path: str, rest: list[str], begun: str, common: dict[str, str]) -> Iterable[Found]:
    declared = words_of(commands.command(path))
    named = {name: word for word in declared if word.is_option for name in word.names}
    placed = [word for word in declared if not word.is_option]
    typed: list[tuple[Parameter, str]] = []
    line = iter(rest)
    for text in line:
        option = text.partition("=")[0]
        if option in named:
            if named[option].type is not bool and "=" not in text and next(line, None) is None:
                return _words(named[option], begun, common, typed)
        elif _takes_value(text):
            if _value(text, line, common) is None:
                return _of_common(text, begun, common)
        elif not text.startswith("-") or takes_signed(declared):
            typed.append((placed[0], text) if placed else (declared[0], text))
            placed = placed if placed and placed[0].many else placed[1:]
    if begun.startswith("-"):
        option, equals, value = begun.partition("=")
        if not equals:
            return _options(path)
        if option not in named:
            return []
        found = _words(named[option], value, common, typed)
        return [Found(f"{option}={fit.word}", fit.about) for fit in found]
    return _words(placed[0], begun, common, typed) if placed else []


def _words(
    word: Parameter, begun: str, common: dict[str, str], typed: list[tuple[Parameter, str]]
) -> Iterable[Found]:
    """Return the values of a declared word: files, or names of the kind that it declares."""
    if word.type is Path:
        return map(Found, _files(begun))
    subject = next((text for other, text in typed if other.declaration.complete in SUBJECTS), "")
    found = names(word.declaration.complete, _connection_options(common), begun, subject)
    if word.declaration.complete == "field":
        given = {text.partition("=")[0] for _, text in typed}
        found = (name for name in found if name.removesuffix("=") not in given)
    return map(Found, found)


def _of_common(option: str, begun: str, common: dict[str, str]) -> Iterable[Found]:
    """Return the values of a common option: live vehicles for --vehicle."""
    kind: Names = "vehicle" if option == "--vehicle" else ""
    return map(Found, names(kind, _connection_options(common), begun, ""))


def _connection_options(common: dict[str, str]) -> Options:
    """Return the options for a connection; --timeout does not apply to a completion."""
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


def _options(path: str) -> Iterator[Found]:
    for word in commands.words_at(path):
        if word.is_option:
            yield from (Found(name, word.declaration.about) for name in word.names)


def _takes_value(text: str) -> bool:
    type_, _ = COMMON.get(text.partition("=")[0].removeprefix("--"), (bool, ""))
    return type_ is not bool


def _value(text: str, line: Iterator[str], common: dict[str, Any]) -> str | None:
    """Take the value of a common option from the line; None if the line ends first."""
    name, equals, value = text.partition("=")
    taken = value if equals else next(line, None)
    if taken is not None:
        common[name.removeprefix("--")] = taken
    return taken
