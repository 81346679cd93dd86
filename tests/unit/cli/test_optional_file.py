"""`--record` with and without a file, in both parsers."""

import pytest

from quadctl.cli import fast_parser, typer_app
from quadctl.cli.fast_parser import given


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
@pytest.mark.parametrize("parser", [fast_parser, typer_app])
def test_a_file_after_record_is_recognised_by_its_ending(line, record, file, parser):
    read = parser.read(given(line.split()))
    assert read is not None
    assert read.values["record"] == record
    assert (read.values["file"] and str(read.values["file"])) == file


def test_other_words_are_unchanged():
    words = ["topic", "pub", "x", "a=", "b.mcap", "--rate", "1"]
    assert given(words) == words
