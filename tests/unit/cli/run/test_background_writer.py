"""Writer of `up`: a reader that does not read, has left or is full stops nothing."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, TextIO

import pytest

from quadctl.cli.run import background_writer
from quadctl.cli.run.background_writer import BackgroundWriter

MOST = 20


class Pipe(NamedTuple):
    """Both ends of a pipe."""

    reader: TextIO
    writer: TextIO


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pipe]:
    monkeypatch.setattr(background_writer, "_MOST", MOST)
    reader, writer = os.pipe()
    with os.fdopen(reader, closefd=False) as ours, os.fdopen(writer, "w") as theirs:
        yield Pipe(ours, theirs)
    os.close(reader)


def test_lines_come_out_in_order_below_each_other(pipe: Pipe):
    with BackgroundWriter(pipe.writer) as writer:
        for number in range(MOST):
            writer.write(f"{number}\n")
    assert [int(pipe.reader.readline()) for _ in range(MOST)] == [*range(MOST)]
    writer.check()


@pytest.mark.parametrize("blocking", [True, False])
def test_a_reader_that_pauses_delays_no_writer_and_gets_the_newest_lines(
    pipe: Pipe, monkeypatch: pytest.MonkeyPatch, blocking: bool
):
    monkeypatch.setattr(background_writer, "_LAST_WAIT", 0.01)
    os.set_blocking(pipe.writer.fileno(), blocking)
    long = "x" * (1 << 20)
    with BackgroundWriter(pipe.writer) as writer:
        writer.write(f"{long}\n")
        # The thread has taken the line when the pipe has begun to fill.
        assert pipe.reader.read(1) == "x"
        for number in range(3 * MOST):
            writer.write(f"{number}\n")
            writer.write()
    assert pipe.reader.readline() == f"{long[1:]}\n"
    assert pipe.reader.readline() == f"... {2 * MOST} lines dropped\n"
    assert [int(pipe.reader.readline()) for _ in range(MOST)] == [*range(2 * MOST, 3 * MOST)]


def test_a_reader_that_has_left_is_reported(pipe: Pipe):
    with BackgroundWriter(pipe.writer) as writer:
        writer.check()
        with Path(os.devnull).open() as nowhere:
            os.dup2(nowhere.fileno(), pipe.reader.fileno())
        writer.write("said\n")
    with pytest.raises(BrokenPipeError):
        writer.check()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has such a file")
def test_a_full_disk_behind_stdout_is_harmless(pipe: Pipe):
    full = os.open("/dev/full", os.O_WRONLY)
    saved = os.dup(pipe.writer.fileno())
    os.dup2(full, pipe.writer.fileno())
    with BackgroundWriter(pipe.writer) as writer:
        writer.write("lost\n")
    os.dup2(saved, pipe.writer.fileno())
    with writer:
        writer.write("said\n")
    writer.check()
    for each in (full, saved):
        os.close(each)
    assert pipe.reader.readline() == "said\n"


def test_a_frame_is_drawn_again_without_a_line(pipe: Pipe):
    with BackgroundWriter(pipe.writer, lambda text: f"{text}table\n") as writer:
        writer.write("said\n")
    with writer:
        writer.write()
    assert [pipe.reader.readline() for _ in range(3)] == ["said\n", "table\n", "table\n"]
