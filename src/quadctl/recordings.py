"""Recordings as NumPy arrays."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from quadctl.services.runtime.recording.reader import Bag
from quadctl.services.runtime.recording.writer import DERIVED

Columns = dict[str, npt.NDArray[Any]]
"""Arrays by field, one row a message, and `received`: the time of the arrival, Unix s."""


def read(file: str | os.PathLike[str]) -> dict[str, Columns]:
    """Read a recording into arrays by key and field.

    `read("flight.mcap")["uav/pose"]["position"]` has shape (n, 3): the components of a vector stand
    in the order of the message, x, y, z or w, x, y, z. Numbers have shape (n,), and so have texts
    and lists, as objects. Units are those of the message. Raises Invalid for an unreadable file.
    """
    rows: dict[str, list[Any]] = {}
    times: dict[str, list[int]] = {}
    for message in Bag(Path(file)).messages(lambda channel: DERIVED not in channel.metadata):
        rows.setdefault(message.key, []).append(message.value)
        times.setdefault(message.key, []).append(message.at)
    return {
        key: _columns(values) | {"received": np.array(times[key]) / 1e9}
        for key, values in rows.items()
    }


def _columns(values: list[Any]) -> Columns:
    if not all(isinstance(value, dict) for value in values):
        return {"value": _column(values)}
    # A field that some messages lack, e.g. of an older version, is None there.
    names = dict.fromkeys(name for value in values for name in value)
    return {name: _column([value.get(name) for value in values]) for name in names}


def _column(values: list[Any]) -> npt.NDArray[Any]:
    if all(isinstance(value, bool) for value in values):
        return np.array(values, dtype=bool)
    if all(isinstance(value, int | float) for value in values):
        return np.array(values)
    if all(isinstance(value, dict) and _is_vector(value) for value in values):
        names = list(values[0])
        if all(list(value) == names for value in values):
            return np.array([list(value.values()) for value in values], dtype=float)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def _is_vector(value: dict[str, Any]) -> bool:
    return bool(value) and all(type(part) in {int, float} for part in value.values())
