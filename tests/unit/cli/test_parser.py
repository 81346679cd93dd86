"""Parser and Typer, made from the same declarations: to both, a line means the same or is refused."""

import io
import shlex
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import pytest
from hypothesis import event, given, settings, strategies as st

from quadctl.cli import commands, parser
from quadctl.cli.declarations import Parameter, ParsedCommand
from quadctl.services.runtime.errors import UsageError
from tests.support import typer_app
from tests.support.command_line import Quadctl

PLACES = ["", *commands.GROUPS, *commands.COMMANDS]
LEFT_TO_TYPER = {"install_completion", "show_completion"}


def options(path: str) -> list[Parameter]:
    words = commands.words_at(path)
    return [word for word in words if word.is_option and word.name not in LEFT_TO_TYPER]


TEXTS = st.text("ab 1-=,._/é", max_size=5)
NUMBERS = st.one_of(st.integers(-3, 3), st.floats(), st.sampled_from(["-1e3", "+1", ".5"])).map(str)
VALUES: dict[Any, st.SearchStrategy[str]] = {
    int: st.sampled_from([-1, 0, 1, 2, 3, 5, 63, 64, 100]).map(str),
    float: NUMBERS,
    str: st.one_of(TEXTS, NUMBERS, st.sampled_from(["pose", "a=1", "x.mcap", "safety"])),
    Path: st.sampled_from(["a.mcap", "lab.toml", "-", "", "a b/c"]),
}
STRAY = st.one_of(
    st.sampled_from(["--", "-", "", "-x", "--nonsense", "--nonsense=1", "help", "topic", "topic echo"]),
    st.sampled_from(["-1", "-.5", "-inf", "-nan", "1_0", "-1_0", "1,5", "abc", "a.mcap"]),
    st.sampled_from(["--help", "-h", "--json", "--json=1", "--timeout", "--timeout=x", "--version"]),
    TEXTS,
)  # fmt: skip


def strays(path: str) -> st.SearchStrategy[str]:
    """Draw a word that may be wrong at a place: an option without a value, a flag with one."""
    names = sorted(name for word in options(path) for name in word.names)
    letters = "".join(name[1] for name in names if len(name) == 2)
    return st.one_of(
        STRAY,
        st.sampled_from(names),
        st.sampled_from(names).map("{}=3".format),
        st.text(f"{letters}-1=x", max_size=4).map("-{}".format),
    )


def used(word: Parameter) -> st.SearchStrategy[list[str]]:
    """Draw the words of one right use of an option."""
    names = st.sampled_from(word.names)
    if word.type is bool:
        return names.map(lambda name: [name])
    values = st.lists(VALUES[word.type], min_size=word.count, max_size=word.count)
    return st.builds(spelled, names, values, st.booleans())


def spelled(name: str, values: list[str], joined: bool) -> list[str]:
    if not joined:
        return [name, *values]
    return [f"{name}{'=' if name.startswith('--') else ''}{values[0]}", *values[1:]]


@st.composite
def arguments(draw: st.DrawFn, path: str) -> list[str]:
    """Draw the words of a command that are no options."""
    texts: list[str] = []
    for word in commands.words_at(path):
        if not word.is_option:
            least, most = int(word.required), 3 if word.many else 1
            texts += draw(st.lists(VALUES[word.type], min_size=least, max_size=most))
    return texts


@st.composite
def lines(draw: st.DrawFn) -> list[str]:
    """Draw a line with options at every place of it, and change up to two of its words."""
    path = draw(st.sampled_from(PLACES))
    names = path.split()
    line: list[str] = []
    for count in range(len(names) + 1):
        place, inner = " ".join(names[:count]), names[count : count + 1]
        pieces = [inner] if inner else [[text] for text in draw(arguments(place))]
        uses = st.sampled_from(options(place)).flatmap(used)
        for use in draw(st.lists(uses, max_size=1 if inner else 4)):
            pieces.insert(0 if inner else draw(st.integers(0, len(pieces))), use)
        line += [text for piece in pieces for text in piece]
    for _ in range(draw(st.sampled_from([0, 1, 1, 2]))):
        at, stray = draw(st.integers(0, len(line))), draw(strays(path))
        word = line[at : at + 1]
        changed = [[], [*word, *word], [stray, *word], [stray]]
        line[at : at + 1] = draw(st.sampled_from(changed))
    return line


def by_parser(words: list[str]) -> ParsedCommand | int:
    try:
        return parser.read(words)
    except UsageError as refusal:
        return refusal.exit_code
    except SystemExit as leaving:
        return int(leaving.code or 0)


def read(reader: Callable[[list[str]], ParsedCommand | int], words: list[str]) -> tuple[Any, ...]:
    """Return the command with its values, or the exit code with the page of help."""
    out = io.StringIO()
    with redirect_stdout(out), redirect_stderr(io.StringIO()):
        found = reader(words)
    if isinstance(found, int):
        return found, out.getvalue() if "Usage:" in out.getvalue() else ""
    # repr: nan is not equal to itself.
    return found.command, repr(sorted(found.common.items())), repr(sorted(found.values.items()))


@settings(max_examples=4 * settings().max_examples)
@given(lines())
def test_the_parser_and_typer_accept_and_refuse_the_same_lines(words: list[str]):
    found = read(by_parser, words)
    event("accepted" if not isinstance(found[0], int) else f"exit code {found[0]}")
    assert found == read(typer_app.read, words)


ACCEPTED = [
    "up -d --set a=1 --set b=2 --without hub quad.toml", "up --set --json", "up -- -d",
    "up --record --json", "up --record x.toml", "up --record x.mcap", "up --record=x",
    "status --json", "--realm help status", "--json topic --realm r list", "--realm a topic --realm b list",
    "status --timeout x --timeout 1", "node kill a b --signal KILL", "node ping -ac 3", "node logs -fn3 -",
    "goto 1 -2 .5 --replace", "goto -1e3 -inf -nan", "goto -- -1 2 3", "goto 1 2 --arrive -1 3",
    "topic pub pose -inf", "topic echo -n 1 pose", "topic hz -w2 pose", "record -o=x", "init -",
    "param set safety.takeoff -1", "lab grade a b --row 1 --row 2", "lab rubric check r a b",
    "bridge mavlink --origin=1 -2 3", "bridge mavlink --origin 1 2 3 --origin 4 5 6",
]  # fmt: skip
REFUSED = [
    "nonsense", "topic", "topic nonsense", "'topic echo' pose", "--json", "--realm", "status extra",
    "status -x", "status -1", "status --json=1", "status --realm", "status --timeout x", "up -dx",
    "up -d-json", "up --detach=1", "-- --json", "-- --help", "goto 1 2", "goto 1 2 x", "goto 1 2 1_0", "goto 1 2 --nonsense",
    "goto 1 2 -- --replace", "goto x --help --nonsense", "topic echo -n 0 pose", "topic echo -n=3 pose",
    "topic echo -n", "topic pub pose -nan", "topic pub -1n5 pose", "bridge mavlink --origin 1 2",
    "node ping -aa=1", "help nonsense", "help topic nonsense",
]  # fmt: skip
ANSWERED = [
    "--help", "-h topic", "topic --help", "help", "help topic", "help topic -x echo", "help help",
    "goto --help", "goto x -h", "status --timeout x --help", "up -dh", "--version", "--version nonsense",
]  # fmt: skip


@pytest.mark.parametrize(
    ("line", "code"),
    [
        *((line, None) for line in ACCEPTED),
        *((line, 2) for line in REFUSED),
        *((line, 0) for line in ANSWERED),
    ],
)
def test_each_rule_holds_for_the_parser_and_for_typer(line: str, code: int | None):
    words = shlex.split(line)
    found = read(by_parser, words)
    assert found == read(typer_app.read, words)
    assert callable(found[0]) if code is None else found[0] == code


@pytest.mark.parametrize("path", PLACES)
def test_a_help_page_is_what_typer_prints(path: str):
    words = [*path.split(), "--help"]
    found = read(by_parser, words)
    assert found == read(typer_app.read, words)
    assert found[1].startswith(f"Usage: {f'quadctl {path}'.rstrip()} ")


@pytest.mark.parametrize(
    ("line", "record", "file"),
    [
        ("up --record", "", None),
        ("up -d --record --json", "", None),
        ("up --record a.mcap", "a.mcap", None),
        ("up --record=a.mcap lab.toml", "a.mcap", "lab.toml"),
        ("up --record lab.toml", "", "lab.toml"),
        ("up lab.toml", None, "lab.toml"),
    ],
)
def test_a_file_after_record_is_recognised_by_its_ending(line, record, file):
    values = parser.read(line.split()).values
    assert values["record"] == record
    assert (values["file"] and str(values["file"])) == file


def test_a_line_and_its_help_load_no_typer(quadctl: Quadctl, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "typer", None)  # an import fails
    for line in ("type list", "type show", "goto 1 2", "--version", "--help", "topic --help", ""):
        assert quadctl(*line.split()).code in {0, 2}
