"""Lines that stay at the bottom of a terminal, while others scroll by above them.

Written by hand: a frame costs a tenth of a millisecond, which a library's table does not.
"""

import re
from typing import TextIO

_ESCAPES = re.compile(r"\033\[[0-9;]*m")
_CLEAR_LINE, _CLEAR_BELOW = "\033[K", "\033[J"


class Panel:
    """Draws on a terminal that nobody else writes to. The cursor rests behind the last line."""

    def __init__(self, terminal: TextIO) -> None:
        self._terminal = terminal
        self._lines: list[str] = []

    def draw(self, above: str, lines: list[str], columns: int) -> None:
        """Put text above the panel, for good, and new lines in the panel's place.

        The text ends with a newline or is empty. `columns` is the terminal's width now, which
        may have changed. Raises OSError where the terminal is gone.
        """
        frame = above + "\n".join(lines)
        self._terminal.write(
            self._back(columns) + frame.replace("\n", f"{_CLEAR_LINE}\n") + _CLEAR_BELOW
        )
        self._terminal.flush()
        self._lines = lines

    def forget(self) -> None:
        """Draw the next one where the cursor is: others have written to the terminal."""
        self._lines = []

    def _back(self, columns: int) -> str:
        """To where the panel begins. A terminal that was made narrower has wrapped its lines."""
        rows = sum(-(-len(_ESCAPES.sub("", line)) // columns) or 1 for line in self._lines)
        return f"\r\033[{rows - 1}A" if rows > 1 else "\r"
