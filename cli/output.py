"""Output to stdout and stderr: text, tables and JSON, also to closed or full streams."""

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TextIO

from quadctl.cli.context import Options
from quadctl.services.runtime.errors import QuadctlError
from quadctl.services.runtime.terminal import escaped, escaped_json


def ensure() -> None:
    """Open the streams that the shell has closed (`<&-`), so that no socket takes their numbers."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # This number is the lowest free one, so it is taken.
            os.open(os.devnull, os.O_RDWR)
    # These numbers and no others: a node that is forked from us gets its own streams there.
    sys.stdout = sys.stdout or os.fdopen(1, "w", encoding="utf-8")
    sys.stderr = sys.stderr or os.fdopen(2, "w", encoding="utf-8")


def _nowhere() -> TextIO:
    return os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")


def write(text: str) -> None:
    """Write to stdout at once; raise as flush does."""
    with _written():
        sys.stdout.write(text)
        sys.stdout.flush()


def flush() -> None:
    """Write out the buffered text; raise QuadctlError if that fails."""
    with _written():
        sys.stdout.flush()
        sys.stderr.flush()


def ensure_read() -> None:
    """Raise BrokenPipeError if the reader at the other end of our stdout pipe has left."""
    import select

    if hasattr(select, "poll"):
        poll = select.poll()
        poll.register(1, 0)  # only errors, which poll always reports
        if any(events & select.POLLERR for _, events in poll.poll(0)):
            raise BrokenPipeError


@contextmanager
def _written() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        # The stream keeps unwritten text and would try again at exit.
        sys.stdout = _nowhere()
        raise QuadctlError(
            f"the output cannot be written: {error.strerror}",
            "is its disk full? The command itself may have succeeded",
        ) from error


_FAULT_FOUND = 8
_WIDEST = 12
"""Characters of a float that is shown without rounding."""


def document(value: Any) -> None:
    """Print one JSON document, on one line, at once."""
    write(escaped_json(value) + "\n")


def line(text: str) -> None:
    """Print text, at once."""
    write(f"{escaped(text)}\n")


def either(options: Options, value: Any, text: str) -> None:
    """Print a document with --json, else a line of text."""
    document(value) if options.json else line(text)


def table(rows: Iterable[Sequence[object]]) -> None:
    """Print rows in aligned columns."""
    texts = [[str(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    for row in texts:
        cells = (f"{cell:{width}}" for cell, width in zip(row, widths, strict=True))
        line("  ".join(cells).rstrip())


def listing(vehicles: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print rows that begin with their vehicle; without that column if there is only one."""
    table(row if len(vehicles) > 1 else row[1:] for row in rows)


def fields(value: Any, indent: str = "") -> None:
    """Print data as `rostopic echo` does: one field per line, nested ones indented."""
    if not isinstance(value, dict):
        line(f"{indent}{_shown(value, quoted=False)}")
        return
    for name, part in value.items():
        if isinstance(part, dict) and part:
            line(f"{indent}{name}:")
            fields(part, indent + "  ")
        else:
            line(f"{indent}{name}: {_shown(part)}")


def note(text: str) -> None:
    """Print a remark to stderr."""
    sys.stderr.write(f"{escaped(text)}\n")


def error(problem: QuadctlError, *, as_json: bool) -> None:
    """Print an error, and its hint, to stderr."""
    if as_json:
        message = "; ".join((problem.message, *problem.others))
        content = {"code": problem.code, "message": message, "hint": problem.hint}
        sys.stderr.write(escaped_json({"error": content}) + "\n")
        return
    for message in (*problem.others, problem.message):
        note(f"error: {message}")
    if problem.hint:
        note(f"  try: {problem.hint}")


def _shown(value: Any, *, quoted: bool = True) -> str:
    """Format a value: nine digits of a float resolve a nanometre in a lab; --json has all."""
    if isinstance(value, float):
        return repr(value) if len(repr(value)) <= _WIDEST else f"{value:.9g}"
    return repr(value) if isinstance(value, str) and quoted else str(value)


def end(*, ok: bool) -> None:
    """Exit with code 8, a fault found, unless `ok`."""
    if not ok:
        sys.exit(_FAULT_FOUND)


def duration(seconds: float) -> str:
    """Format a time as `3 s`, `2:03` or `1:02:03`."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours}:{minutes:02}:{rest:02}"
    return f"{minutes}:{rest:02}" if minutes else f"{rest} s"
