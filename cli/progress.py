"""Progress bars for one vehicle or a fleet."""

import sys
import time
from collections.abc import Iterable
from typing import Any, Self

from quadctl.cli import output


class Progress:
    """Bar with a fraction and a text, on stderr; without a terminal nothing, or lines."""

    def __init__(self, title: str, *, quiet: bool, line_every: float = 0.0) -> None:
        """Show a bar unless `quiet`; without a terminal write a line every so many s, if any."""
        self._title = title
        self._bar: Any = None
        self._line_every, self._line_at = line_every, time.monotonic() + line_every
        if not quiet and sys.stderr.isatty() and sys.stdout.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress as Bar, TextColumn

            self._bar = Bar(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.fields[text]}"),
                console=Console(stderr=True),
                transient=True,
            )

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
            self._task = self._bar.add_task(self._title, total=1.0, text="")
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def update(self, fraction: float, text: str) -> None:
        """Show a fraction, from 0 to 1, and a text."""
        if self._bar is not None:
            self._bar.update(self._task, completed=min(max(fraction, 0.0), 1.0), text=text)
        elif self._line_every and time.monotonic() >= self._line_at:
            self._line_at = time.monotonic() + self._line_every
            output.note(text)


class FleetProgress(Progress):
    """Progress of a fleet; each vehicle's own thread reports it."""

    def __init__(self, title: str, names: Iterable[str], *, quiet: bool) -> None:
        super().__init__(title, quiet=quiet)
        self._flown = dict.fromkeys(names, 0.0)
        self._left = dict.fromkeys(self._flown, 0.0)

    def fly(self, name: str, left: float, whole: float) -> None:
        """Report that a vehicle has `left` m to go of its `whole` way."""
        self._flown[name], self._left[name] = 1 - left / whole, left
        arrived = sum(flown >= 1 for flown in self._flown.values())
        text = f"{arrived} of {len(self._flown)} there, {max(self._left.values()):.2f} m to go"
        self.update(sum(self._flown.values()) / len(self._flown), text)
