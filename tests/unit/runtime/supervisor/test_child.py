"""Output of a child process, split into lines and limited in size."""

import io
import itertools

from hypothesis import given, strategies as st

from quadctl.services.runtime.supervisor.child import FEW, LONGEST, MOST, LineBuffer


def texts(lines: LineBuffer) -> list[str]:
    return [taken.line for taken in lines.take()]


@given(
    st.lists(
        st.text(st.characters(codec="utf-8", exclude_characters="\r\n"), max_size=9), max_size=9
    ),
    st.lists(st.integers(1, 9), min_size=1, max_size=5),
)
def test_lines_do_not_depend_on_the_chunks_they_arrive_in(written: list[str], sizes: list[int]):
    pipe = io.BytesIO("".join(f"{line}\r\n" for line in written).encode())
    lines = LineBuffer("x")
    for size in itertools.cycle(sizes):
        if not (chunk := pipe.read(size)):
            break
        assert lines.feed(chunk)
    assert texts(lines) == written
    lines.end()
    assert texts(lines) == []


def test_a_line_has_name_and_time_and_the_last_needs_no_newline():
    lines = LineBuffer("camera")
    lines.feed(b"one\ntw")
    lines.feed(b"o")
    first, *more = lines.take()
    assert (first.name, first.line, more) == ("camera", "one", [])
    lines.end()
    (second,) = lines.take()
    assert second.line == "two"
    assert second.at >= first.at > 1e9


def test_bytes_without_a_newline_are_shown_once_and_dropped():
    lines = LineBuffer("x")
    assert lines.feed(b"z" * 65536)
    for _ in range(1000):
        assert not lines.feed(b"z" * 65536)
    assert texts(lines) == ["z" * LONGEST + " ... (cut)"]
    assert len(lines._part) <= LONGEST
    lines.feed(b"the line's end\nnext\nlast")
    lines.end()
    assert texts(lines) == ["next", "last"]


def test_a_line_above_the_limit_is_cut():
    lines = LineBuffer("x")
    lines.feed(b"a" * LONGEST + b"\n" + b"b" * (LONGEST + 1) + b"\nc\n")
    assert texts(lines) == ["a" * LONGEST, "b" * LONGEST + " ... (cut)", "c"]


def test_surplus_lines_are_counted_and_the_reader_is_paused():
    lines = LineBuffer("yes")
    assert lines.feed(b"y\n" * FEW)
    assert not lines.feed(b"y\n" * (MOST - FEW))
    for _ in range(100):
        assert not lines.feed(b"y\n" * 1000)
    taken = texts(lines)
    assert taken == ["y"] * MOST + ["... 100000 lines dropped"]
    assert lines.feed(b"again\n")
    assert texts(lines) == ["again"]


def test_bytes_that_are_no_text_are_a_line_too():
    lines = LineBuffer("x")
    lines.feed(b"\xff\x00\n\n")
    assert texts(lines) == ["�\x00", ""]
