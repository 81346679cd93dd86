"""Room for what a straight line works on."""

from collections.abc import Sequence

import numpy as np

from services.dynamics.fleet.storage import Numbers, aligned
from services.dynamics.fleet.straight.emit import Program


class Scratch:
    """Room to work in for some programs, one at a time, on so many vehicles at most."""

    def __init__(self, programs: Sequence[Program], width: int) -> None:
        width = max(width, 2)
        self._work = aligned(max(each.works for each in programs), width)
        self._mask = np.empty((max(each.masks for each in programs), width), dtype=bool)

    def run(self, program: Program, rows: Numbers, times: int) -> None:
        """Run a program so many times on rows, a column for each vehicle."""
        width = rows.shape[1]
        if width == 1:
            # Numpy takes what has one element the long way, at twice the time.
            pair = np.repeat(rows, 2, axis=1)
            self.run(program, pair, times)
            rows[...] = pair[:, :1]
            return
        program.run(rows, self._work[:, :width], self._mask[:, :width], times)
