"""What `up` shows on a terminal: its processes in a table, their lines above it."""

import io
import os
import sys
import time
from types import TracebackType
from typing import Self

from cli.output import duration
from cli.run import terminal
from cli.run.panel import Panel
from cli.run.rows import Taken, lines
from cli.run.usage import Shares
from services.runtime.procfs import stats_of
from services.runtime.realm import Realm
from services.runtime.run_files import ProcessRecord
from services.runtime.supervisor.launch import Launch
from services.runtime.supervisor.logs import Printer
from services.runtime.supervisor.probes import Rates
from services.runtime.supervisor.supervisor import Supervisor

_EVERY = 1.0
"""Seconds between two measurements of rates, memory and processor."""
_STOPPED = 3.0
"""Seconds without a look, after which this process was stopped and the shell has written here."""
_LEAVE = 3
"""Rows of the terminal that the table leaves to the lines, at least."""


class Screen:
    """Draws when the supervisor's loop turns, and only what has changed."""

    def __init__(self, launch: Launch) -> None:
        self._launch = launch
        self._colour = terminal.has_colour()
        self._panel = Panel(sys.stdout)
        self._waiting = _Sheet(self._colour)
        self._printer = Printer(self._waiting)
        self._rates: Rates | None = None
        self._shares = Shares()
        self._taken = Taken({}, {}, {})
        self._began = self._looked = time.monotonic()
        self._measured = 0.0
        self._drawn: tuple[list[ProcessRecord], os.terminal_size] | None = None
        self._gone = False

    def __enter__(self) -> Self:
        self._echo = terminal.without_echo()
        self._echo.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the lines, and nothing else."""
        try:
            if self._rates is not None:
                self._rates.close()
            self._draw([], _size().columns)
        finally:
            self._echo.__exit__(kind, error, trace)

    def emit(self, name: str, line: str, at: float) -> None:
        """Have a process's line shown at the next look."""
        self._printer(name, line, at)

    def look(self, supervisor: Supervisor) -> None:
        """Bring the screen up to date."""
        now, rows = time.monotonic(), supervisor.rows()
        if now - self._looked > _STOPPED:
            self._panel.forget()
        self._looked = now
        due = now - self._measured >= _EVERY
        if due:
            self._measured = now
            self._measure(rows, now)
        size = _size()
        if due or self._waiting.tell() or (rows, size) != self._drawn:
            self._drawn = rows, size
            self._draw(self._table(rows, now, size) if terminal.is_ours() else [], size.columns)

    def _measure(self, rows: list[ProcessRecord], now: float) -> None:
        if self._rates is None:
            # Not before now: what has threads cannot fork, and the processes are forked.
            self._rates = Rates(Realm(self._launch.realm), self._launch.vehicles)
        stats = {row.pid: stats_of(row.pid) for row in rows if row.pid}
        memory = {pid: each.rss / 1e6 for pid, each in stats.items() if each.rss is not None}
        busy = {pid: each.cpu for pid, each in stats.items() if each.cpu is not None}
        self._taken = Taken(self._rates.look(), memory, self._shares.look(busy, now))

    def _table(self, rows: list[ProcessRecord], now: float, size: os.terminal_size) -> list[str]:
        ready = sum(row.state == "ready" for row in rows)
        head = (
            f"realm {self._launch.realm}: {ready} of {len(rows)} ready,"
            f" up {duration(now - self._began)}; Ctrl-C stops all"
        )
        height = min(len(rows) + 2, size.lines - _LEAVE)
        return lines(head, rows, self._taken, size.columns, height, colour=self._colour)

    def _draw(self, table: list[str], columns: int) -> None:
        above = self._waiting.take()
        if self._gone:
            return
        try:
            self._panel.draw(above, table, columns)
        except OSError:
            # A closed terminal is no reason to fall; the files have every line.
            self._gone = True


class _Sheet(io.StringIO):
    """Collects text for a terminal."""

    def __init__(self, colour: bool) -> None:
        super().__init__()
        self._colour = colour

    def isatty(self) -> bool:
        return self._colour

    def take(self) -> str:
        text = self.getvalue()
        self.seek(0)
        self.truncate()
        return text


def _size() -> os.terminal_size:
    try:
        size = os.get_terminal_size(sys.stdout.fileno())
    except OSError:
        return os.terminal_size((80, 24))
    # A terminal that was never told its size says 0.
    return size if size.columns and size.lines else os.terminal_size((80, 24))
