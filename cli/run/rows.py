"""A run's processes as the lines of a table that fits the terminal."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from services.runtime.run_files import ProcessRecord

_GAP = "  "
_COLOURS = {"ready": 32, "starting": 33, "restarting": 33, "down": 31}
_DIM = 2
_STATE = 1
_TITLES = ("NAME", "STATE", "PID", "RESTARTS", "MSG/S", "MEMORY", "CPU")
_FEWEST = 2
"""Columns that stay however narrow the terminal is: the name and the state."""


class Taken(NamedTuple):
    """What is known of processes beside their records.

    Messages per second by node; megabytes and per cent of a core by pid.
    """

    rates: Mapping[str, float]
    memory: Mapping[int, float]
    shares: Mapping[int, float]


def lines(
    head: str,
    rows: Sequence[ProcessRecord],
    taken: Taken,
    columns: int,
    height: int,
    *,
    colour: bool,
) -> list[str]:
    """A head, and a table with a line for each process; fewer columns or rows where they do not fit.

    No line fills the terminal's width, lest it wrap.
    """
    texts = [_TITLES, *(_texts(row, taken) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    shown = len(widths)
    while shown > _FEWEST and sum(widths[:shown]) + len(_GAP) * (shown - 1) >= columns:
        shown -= 1
    found = [_painted(head[: columns - 1], _DIM, colour=colour)]
    for place, row in enumerate(texts[: max(height - 1, 0)]):
        cells = [f"{text:{width}}" for text, width in zip(row[:shown], widths, strict=False)]
        line = _GAP.join(cells).rstrip()[: columns - 1]
        if not place:
            line = _painted(line, _DIM, colour=colour)
        elif len(line) >= widths[0] + len(_GAP) + len(row[_STATE]):
            state = _painted(row[_STATE], _COLOURS[row[_STATE]], colour=colour)
            begins = widths[0] + len(_GAP)
            line = line[:begins] + state + line[begins + len(row[_STATE]) :]
        found.append(line)
    return found


def _texts(row: ProcessRecord, taken: Taken) -> tuple[str, ...]:
    return (
        row.name,
        row.state,
        str(row.pid or "-"),
        str(row.restarts),
        _number(taken.rates.get(row.name) if row.state == "ready" else None),
        _number(taken.memory.get(row.pid), " MB"),
        _number(taken.shares.get(row.pid), " %"),
    )


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else f"{value:.0f}{unit}"


def _painted(text: str, number: int, *, colour: bool) -> str:
    return f"\033[{number}m{text}\033[0m" if colour else text
