"""The log stream: every line with its process's name, on the stream and in a file."""

import io
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from quadctl.services.runtime.supervisor.logs import Logs, Printer

LINE = r"\d\d:\d\d:\d\d\.\d\d\d "


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


Make = Callable[[io.StringIO], Logs]


@pytest.fixture
def made(tmp_path: Path) -> Iterator[Make]:
    """Makes logs; a run's files stay open to its end, so the test closes them."""
    every: list[Logs] = []

    def make(out: io.StringIO) -> Logs:
        every.append(Logs(tmp_path / "logs", Printer(out)))
        return every[-1]

    yield make
    for logs in every:
        logs.close()


def test_a_line_has_time_and_name_and_no_colour_when_piped(made: Make):
    out = io.StringIO()
    logs = made(out)
    logs.show("hub", "up")
    logs.show("dynamics", "boot 1")
    first, second = out.getvalue().splitlines()
    assert re.fullmatch(LINE + r"hub      \| up", first)
    assert re.fullmatch(LINE + r"dynamics \| boot 1", second)


def test_on_a_terminal_each_process_has_its_colour(made: Make):
    out = Terminal()
    logs = made(out)
    for name in ("hub", "safety", "hub"):
        logs.show(name, "said")
    colours = re.findall(r"\x1b\[(\d\d)m", out.getvalue())
    assert colours[0] == colours[2]
    assert colours[0] != colours[1]
    assert all(line.endswith("\x1b[0m said") for line in out.getvalue().splitlines())


def test_more_processes_than_colours_have_colours_again(made: Make):
    out = Terminal()
    logs = made(out)
    for number in range(20):
        logs.show(f"node{number}", "said")
    assert len(out.getvalue().splitlines()) == 20


def test_the_file_has_the_line_alone_at_once_and_goes_on(made: Make, tmp_path: Path):
    folder = tmp_path / "logs"
    logs = made(io.StringIO())
    logs.show("safety", "Param: cage x - [-5.0, 5.0]")
    assert (folder / "safety.log").read_text() == "Param: cage x - [-5.0, 5.0]\n"
    logs.show("safety", "größer")
    made(io.StringIO()).show("safety", "again")
    text = (folder / "safety.log").read_text(encoding="utf-8")
    assert text.splitlines()[1:] == ["größer", "again"]


@pytest.mark.parametrize(("count", "first"), [(3, 0), (20, 0), (25, 5)])
def test_the_last_lines_are_kept_for_who_asks_why(made: Make, count: int, first: int):
    logs = made(io.StringIO())
    for number in range(count):
        logs.show("hub", f"line {number}")
    assert logs.last("hub").splitlines() == [f"  line {n}" for n in range(first, count)]
    assert logs.last("nobody") == ""


def test_a_line_has_the_time_at_which_it_was_read(made: Make):
    out = io.StringIO()
    made(out).show("hub", "up", 1e9 + 0.25)
    assert out.getvalue()[5:12] == ":40.250"
