"""The fast parser and Typer read the same declarations, so both parse a line alike."""

import pytest
from hypothesis import example, given, settings, strategies as st

from quadctl.cli import fast_parser, typer_app
from quadctl.cli.commands import COMMANDS, command
from quadctl.cli.context import COMMON
from quadctl.cli.declarations import Option, ParsedCommand, words_of
from quadctl.services.runtime.errors import UsageError

OWN = sorted(
    {
        name
        for path in COMMANDS
        for word in words_of(command(path))
        if isinstance(word.declaration, Option)
        for name in word.names
    }
)
VALUES = ["1", "-2", "0", "1.5", "nan", "-inf", "pose", "a=1", "a=-1", "{}", "", "x y", "--", "-"]
WORDS = [*OWN, *(f"--{name}" for name in COMMON), *(f"{name}=3" for name in OWN), "--help", "-x"]


def by_typer(words: list[str]) -> ParsedCommand | None:
    try:
        return typer_app.read(words)
    except (UsageError, SystemExit):
        return None


@settings(max_examples=300)
@example(["topic", "pub"], ["-inf"], [])  # -n is an option there
@given(
    st.sampled_from(sorted(COMMANDS)).map(str.split),
    st.lists(st.sampled_from(VALUES + WORDS), max_size=6),
    st.lists(st.sampled_from(["--json", "--realm=r", "--timeout", "2"]), max_size=2),
)
def test_typer_agrees_with_every_line_the_fast_parser_accepts(path, words, before):
    line = [*before, *path, *words]
    found = fast_parser.read(line)
    if found is not None:
        other = by_typer(line)
        assert other is not None
        assert (found.command, found.common) == (other.command, other.common)
        # repr: nan is not equal to itself.
        assert repr(sorted(found.values.items())) == repr(sorted(other.values.items()))


PLAIN = [
    "up -d --set a=1 --set b=2 --without hub quad.toml", "status --json", "goto 1 -2 .5 --replace",
    "cage off --timeout 1", "--realm r topic list", "topic echo pose -n 3 --field position.z",
    "service call goto x=1 y=2 z=-3", "service call toggle_cage False --json", "param get a b",
    "node ping -a -c 3", "node kill a b --signal KILL", "param list /safety",
    "param set safety.takeoff -1", "type show goto", "ps", "node list --connect tls/h:1",
]  # fmt: skip


@pytest.mark.parametrize("line", PLAIN)
def test_a_plain_line_is_parsed_without_typer(line: str):
    assert fast_parser.read(line.split()) is not None


@pytest.mark.parametrize("line", ["", "--help", "goto 1 2", "topic", "nonsense", "status -x"])
def test_other_lines_are_left_to_typer(line: str):
    assert fast_parser.read(line.split()) is None
