"""Table of `up` on a terminal: redrawn in place, within the width, erased at the end."""

import pytest
from hypothesis import given, strategies as st

from quadctl.cli.output import duration
from quadctl.cli.run.screen import Measurements, Panel, Shares, lines
from quadctl.services.runtime.run_files import ProcessRecord
from tests.support.screen import Glass

ROWS = [
    ProcessRecord("hub", 12345, "ready", 0),
    ProcessRecord("dynamics", 0, "restarting", 3),
    ProcessRecord("a-helper-of-mine", 7, "down", 5),
]
TAKEN = Measurements({"hub": 12.4, "dynamics": 100.0}, {12345: 27.3}, {12345: 3.2})
NONE = Measurements({}, {}, {})
TEXT = st.text("abc xyz", max_size=12).map(str.rstrip)


@given(st.lists(st.tuples(st.lists(TEXT, max_size=3), st.lists(TEXT, max_size=4)), max_size=8))
def test_log_lines_are_kept_above_the_panel(frames):
    glass, panel = Glass(), Panel()
    above: list[str] = []
    for written, table in [*frames, ([], [])]:
        drawn = panel.draw("".join(f"{line}\n" for line in written), table, 80)
        glass.feed(drawn.replace("\n", "\r\n"))
        above += written
        assert glass.seen == "\n".join([*above, *(table or [""])])


def test_panel_wrapped_by_a_narrower_terminal_is_erased_whole():
    panel = Panel()
    panel.draw("", ["\033[2m" + 25 * "a" + "\033[0m", 10 * "b", ""], 40)
    assert panel.draw("", [], 10) == "\r\033[4A\033[J"


def test_after_other_output_the_panel_starts_at_the_cursor():
    panel = Panel()
    panel.draw("", ["a", "b"], 40)
    panel.forget()
    assert panel.draw("", ["c"], 40) == "\rc\033[J"


def test_each_process_has_a_row():
    assert lines("head", ROWS, TAKEN, 100, 10, colour=False) == [
        "head",
        "NAME              STATE       PID    RESTARTS  MSG/S  MEMORY  CPU",
        "hub               ready       12345  0         12     27 MB   3 %",
        "dynamics          restarting  -      3         -      -       -",
        "a-helper-of-mine  down        7      5         -      -       -",
    ]


def test_colour_does_not_change_the_text():
    plain = lines("head", ROWS, TAKEN, 60, 10, colour=False)
    glass = Glass()
    glass.feed("\r\n".join(lines("head", ROWS, TAKEN, 60, 10, colour=True)))
    assert glass.seen == "\n".join(plain)


@given(st.integers(1, 120), st.integers(0, 8), st.booleans())
def test_the_table_fits_any_terminal(columns: int, height: int, colour: bool):
    glass = Glass()
    glass.feed("\r\n".join(lines("a head", ROWS, NONE, columns, height, colour=colour)))
    assert len(glass.lines) <= max(height, 1)
    assert all(len(line) < columns for line in glass.lines)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.0, "0 s"), (59.9, "59 s"), (61, "1:01"), (3600, "1:00:00")]
)
def test_a_duration_is_formatted(seconds: float, text: str):
    assert duration(seconds) == text


def test_the_share_of_a_core_covers_the_time_between_samples():
    shares = Shares()
    assert shares.look({7: 2.0}, 10.0) == {}
    assert shares.look({7: 3.0}, 20.0) == {7: pytest.approx(10.0)}
    assert shares.look({}, 30.0) == {}
    assert shares.look({7: 4.0}, 40.0) == {}
