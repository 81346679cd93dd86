"""How far all vehicles are, in one bar on a terminal."""

from collections.abc import Iterable
from typing import Self

from cli.lab.progress import Progress


class Board:
    """Told of every vehicle's way by its own thread."""

    def __init__(self, title: str, names: Iterable[str], *, quiet: bool) -> None:
        self._bar = Progress(title, quiet=quiet)
        self._flown = dict.fromkeys(names, 0.0)
        self._left = dict.fromkeys(self._flown, 0.0)

    def __enter__(self) -> Self:
        self._bar.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.__exit__()

    def update(self, name: str, left: float, whole: float) -> None:
        """A vehicle has so much of its whole way left, m."""
        self._flown[name], self._left[name] = 1 - left / whole, left
        there = sum(flown >= 1 for flown in self._flown.values())
        self._bar.update(
            sum(self._flown.values()) / len(self._flown),
            f"{there} of {len(self._flown)} there, {max(self._left.values()):.2f} m to go",
        )
