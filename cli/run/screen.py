"""Live table of `up` on a terminal.

Written by hand: a frame takes a tenth of a millisecond, less than with any table library.
"""

import contextlib
import os
import re
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, Self

from quadctl.cli.output import duration
from quadctl.cli.run.background_writer import BackgroundWriter
from quadctl.services.runtime.procfs import stats_of
from quadctl.services.runtime.realm import Realm
from quadctl.services.runtime.run_files import ProcessRecord
from quadctl.services.runtime.supervisor.launch import Launch
from quadctl.services.runtime.supervisor.logs import Printer
from quadctl.services.runtime.supervisor.probes import RateProbe
from quadctl.services.runtime.supervisor.supervisor import Supervisor

_ESCAPES = re.compile(r"\033\[[0-9;]*m")
_CLEAR_LINE, _CLEAR_BELOW = "\033[K", "\033[J"


class Panel:
    """Panel on a terminal without other writers. The cursor rests behind the last line."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def draw(self, above: str, lines: list[str], columns: int) -> str:
        """Return what writes text above the panel, permanently, and replaces the panel's lines.

        The text is empty or ends with a newline. `columns` is the terminal's width, which may have
        changed.
        """
        frame = (above + "\n".join(lines)).replace("\n", f"{_CLEAR_LINE}\n")
        back, self._lines = self._back(columns), lines
        return back + frame + _CLEAR_BELOW

    def forget(self) -> None:
        """Draw the next panel at the cursor: others have written to the terminal."""
        self._lines = []

    def _back(self, columns: int) -> str:
        """Return the escape to the panel's start; a narrowed terminal has wrapped its lines."""
        rows = sum(-(-len(_ESCAPES.sub("", line)) // columns) or 1 for line in self._lines)
        return f"\r\033[{rows - 1}A" if rows > 1 else "\r"


_GAP = "  "
_COLOURS = {"ready": 32, "starting": 33, "restarting": 33, "down": 31}
_DIM = 2
_STATE = 1
_TITLES = ("NAME", "STATE", "PID", "RESTARTS", "MSG/S", "MEMORY", "CPU")
_FEWEST = 2
"""Columns that stay in a terminal of any width: the name and the state."""


class Measurements(NamedTuple):
    """Messages per second by node; megabytes and per cent of a core by pid."""

    rates: Mapping[str, float]
    memory: Mapping[int, float]
    shares: Mapping[int, float]


def lines(
    head: str,
    rows: Sequence[ProcessRecord],
    taken: Measurements,
    columns: int,
    height: int,
    *,
    colour: bool,
) -> list[str]:
    """Return a head and a table with a line per process, without columns or rows that do not fit.

    No line fills the terminal's width, so that none wraps.
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


def _texts(row: ProcessRecord, taken: Measurements) -> tuple[str, ...]:
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


def is_live() -> bool:
    """Return whether stdout is a terminal that can move its cursor and is this job's."""
    return _is_able() and is_ours()


def is_ours() -> bool:
    """Return whether the terminal is this job's; false in the background (`&`)."""
    if sys.platform == "win32":
        return True
    try:
        return os.tcgetpgrp(sys.stdout.fileno()) == os.getpgrp()
    except OSError:
        # A terminal of another session, e.g. opened by a test or a service manager.
        return False


def has_colour() -> bool:
    """Return whether to use colour, by the convention of no-color.org."""
    return _is_able() and not os.environ.get("NO_COLOR")


def _is_able() -> bool:
    return sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb"


@contextlib.contextmanager
def without_echo() -> Iterator[None]:
    """Keep the keys pressed during the block out of the display; they are dropped."""
    if sys.platform == "win32" or not sys.stdin.isatty() or not is_ours():
        yield
        return
    import termios

    kept = termios.tcgetattr(sys.stdin)
    quiet = [*kept[:3], kept[3] & ~termios.ECHO, *kept[4:]]
    termios.tcsetattr(sys.stdin, termios.TCSANOW, quiet)
    try:
        yield
    finally:
        # The terminal may be closed by now.
        with contextlib.suppress(termios.error):
            # TCSAFLUSH would wait for the reader of a terminal that Ctrl-S has stopped.
            termios.tcflush(sys.stdin, termios.TCIFLUSH)
            termios.tcsetattr(sys.stdin, termios.TCSANOW, kept)


_EVERY = 1.0
"""Seconds between two measurements of rates, memory and processor."""
_STOPPED = 3.0
"""Seconds between two looks that mean: this process was stopped, and the shell wrote here."""
_LEAVE = 3
"""Rows of the terminal that the table always leaves to the lines."""


class Shares:
    """Shares of a core, from the CPU times of two looks."""

    def __init__(self) -> None:
        self._last: dict[int, tuple[float, float]] = {}

    def look(self, taken: Mapping[int, float], now: float) -> dict[int, float]:
        """Return per cent of a core by pid, since the previous look at the process.

        `taken` has the CPU time (s) by pid, `now` is a clock's time (s).
        """
        shares = {
            pid: 100 * (cpu - self._last[pid][0]) / (now - self._last[pid][1])
            for pid, cpu in taken.items()
            if pid in self._last and now > self._last[pid][1]
        }
        self._last = {pid: (cpu, now) for pid, cpu in taken.items()}
        return shares


class Screen:
    """Screen drawn after a look of the supervisor's loop or a line, if something has changed."""

    def __init__(self, launch: Launch) -> None:
        self._launch = launch
        self._colour = has_colour()
        self._panel, self._table = Panel(), list[str]()
        self._writer = BackgroundWriter(sys.stdout, self._framed)
        self.emit = Printer(self._writer.write, colour=self._colour)
        """Printer of the processes' lines."""
        self._rates: RateProbe | None = None
        self._shares = Shares()
        self._taken = Measurements({}, {}, {})
        self._began = self._looked = time.monotonic()
        self._measured = 0.0
        self._drawn: tuple[list[ProcessRecord], os.terminal_size] | None = None

    def __enter__(self) -> Self:
        self._echo = without_echo()
        self._echo.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the table and leave the lines."""
        try:
            if self._rates is not None:
                self._rates.close()
            with self._writer:
                self._show([])
        finally:
            self._echo.__exit__(None, None, None)

    def look(self, supervisor: Supervisor) -> None:
        """Update the screen."""
        now, rows = time.monotonic(), supervisor.rows()
        if now - self._looked > _STOPPED:
            self._panel.forget()
        self._looked = now
        due = now - self._measured >= _EVERY
        if due:
            self._measured = now
            self._measure(rows, now)
        size = _size()
        if due or (rows, size) != self._drawn:
            self._drawn = rows, size
            self._show(self._rows(rows, now, size) if is_ours() else [])

    def _measure(self, rows: list[ProcessRecord], now: float) -> None:
        if self._rates is None:
            # Not earlier: it starts threads, after which the processes could not be forked.
            self._rates = RateProbe(Realm(self._launch.realm), self._launch.vehicles)
        stats = {row.pid: stats_of(row.pid) for row in rows if row.pid}
        memory = {pid: each.rss / 1e6 for pid, each in stats.items() if each.rss is not None}
        busy = {pid: each.cpu for pid, each in stats.items() if each.cpu is not None}
        self._taken = Measurements(self._rates.look(), memory, self._shares.look(busy, now))

    def _rows(self, rows: list[ProcessRecord], now: float, size: os.terminal_size) -> list[str]:
        ready = sum(row.state == "ready" for row in rows)
        head = (
            f"realm {self._launch.realm}: {ready} of {len(rows)} ready,"
            f" up {duration(now - self._began)}; Ctrl-C stops all"
        )
        height = min(len(rows) + 2, size.lines - _LEAVE)
        return lines(head, rows, self._taken, size.columns, height, colour=self._colour)

    def _show(self, table: list[str]) -> None:
        self._table = table
        self._writer.write()

    def _framed(self, above: str) -> str:
        return self._panel.draw(above, self._table, _size().columns)


def _size() -> os.terminal_size:
    try:
        size = os.get_terminal_size(sys.stdout.fileno())
    except OSError:
        return os.terminal_size((80, 24))
    # A terminal reports 0 until its size is set.
    return size if size.columns and size.lines else os.terminal_size((80, 24))
