"""Where the vehicles' numbers stand in memory."""

import numpy as np
import numpy.typing as npt

LINE = 8
"""Numbers in a cache line, and in the longest vector."""


def aligned(rows: int, columns: int) -> npt.NDArray[np.float64]:
    """Rows that each begin where a cache line does: a vector then is one line, never part of two."""
    width = -(-columns // LINE) * LINE
    room = np.empty(rows * width + LINE)
    first = -room.ctypes.data // room.itemsize % LINE
    return room[first : first + rows * width].reshape(rows, width)[:, :columns]
