"""Tail of a log file that grows, is emptied, and is rotated."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from quadctl.cli.node.logs import Tail


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "safety.log"


@pytest.fixture
def tail(log: Path) -> Iterator[Tail]:
    with Tail(log) as made:
        yield made


def add(log: Path, text: str) -> None:
    with log.open("a", encoding="utf-8") as out:
        out.write(text)


def rotate(log: Path) -> None:
    log.replace(log.with_name(f"{log.name}.1"))


def test_a_file_may_appear_later(log: Path, tail: Tail):
    assert tail.all() == tail.more() == []
    add(log, "one\n")
    assert tail.more() == ["one"]


def test_each_line_is_returned_whole_and_once(log: Path, tail: Tail):
    add(log, "one\ntw")
    assert tail.all() == ["one"]
    assert tail.more() == []
    add(log, "o\n\nthree\n")
    assert tail.more() == ["two", "", "three"]


def test_a_full_file_is_read_to_its_end_before_the_next(log: Path, tail: Tail):
    add(log, "one\n")
    assert tail.all() == ["one"]
    add(log, "two\n")
    rotate(log)
    # For a moment there may be no file of that name.
    assert tail.more() == ["two"]
    add(log.with_name("safety.log.1"), "three\n")
    add(log, "four\n")
    assert tail.more() == ["three", "four"]
    add(log, "five\n")
    assert tail.more() == ["five"]


def test_the_older_file_comes_first(log: Path, tail: Tail):
    add(log, "one\n")
    rotate(log)
    add(log, "two\n")
    assert tail.all() == ["one", "two"]


def test_an_emptied_file_is_read_from_its_start(log: Path, tail: Tail):
    add(log, "one\ntwo\nha")
    tail.all()
    log.write_text("new\n", encoding="utf-8")
    assert tail.more() == ["new"]
    add(log, "newer\n")
    assert tail.more() == ["newer"]


def test_the_last_lines_of_a_removed_file_are_read(log: Path, tail: Tail):
    add(log, "one\n")
    tail.all()
    add(log, "two\n")
    log.unlink()
    assert tail.more() == ["two"]
    assert tail.more() == []
