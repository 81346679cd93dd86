"""What commands print: documents on stdout, errors on stderr, both as text or as JSON."""

import sys
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from cli import streams
from cli.options import Options
from services.runtime.errors import QuadctlError

_WIDEST = 12
"""Characters of a float that are shown as they are."""

_TAME = {code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if code not in b"\t\n"}
"""How what would steer a terminal is shown: strings come from anybody on the bus."""


def document(value: Any) -> None:
    """Print one JSON document, on one line, at once."""
    streams.say(msgspec.json.encode(value).decode() + "\n")


def line(text: str) -> None:
    """Print text, at once."""
    streams.say(f"{text.translate(_TAME)}\n")


def either(options: Options, value: Any, text: str) -> None:
    """Print a document where --json asks for one, a line of text otherwise."""
    document(value) if options.json else line(text)


def table(rows: Iterable[Sequence[object]]) -> None:
    """Print rows, one a line, in aligned columns."""
    texts = [[str(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    for row in texts:
        cells = (f"{cell:{width}}" for cell, width in zip(row, widths, strict=True))
        line("  ".join(cells).rstrip())


def fields(value: Any, indent: str = "") -> None:
    """Print data as `rostopic echo` does: a field a line, nested ones indented."""
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
    """Say something beside the output proper, on stderr."""
    sys.stderr.write(f"{text.translate(_TAME)}\n")


def error(problem: QuadctlError, *, as_json: bool) -> None:
    """Print what went wrong and what to do about it, on stderr."""
    if as_json:
        message = "; ".join((problem.message, *problem.others))
        said = {"code": problem.code, "message": message, "hint": problem.hint}
        sys.stderr.write(msgspec.json.encode({"error": said}).decode() + "\n")
        return
    for message in (*problem.others, problem.message):
        note(f"error: {message}")
    if problem.hint:
        note(f"  try: {problem.hint}")


def _shown(value: Any, *, quoted: bool = True) -> str:
    """Nine digits of a float tell a nanometre from a lab; --json has them all."""
    if isinstance(value, float):
        return repr(value) if len(repr(value)) <= _WIDEST else f"{value:.9g}"
    return repr(value) if isinstance(value, str) and quoted else str(value)


def duration(seconds: float) -> str:
    """A time as `3 s`, `2:03` or `1:02:03`."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours}:{minutes:02}:{rest:02}"
    return f"{minutes}:{rest:02}" if minutes else f"{rest} s"
