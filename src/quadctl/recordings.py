"""Recordings as NumPy arrays."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.names import nearest
from quadctl.services.runtime.recording.reader import Bag
from quadctl.services.runtime.recording.writer import DERIVED
from quadctl.services.runtime.typed import argument

Columns = dict[str, npt.NDArray[Any]]
"""Arrays by field, one row a message, and `received`: the time of the arrival, Unix s."""


class UnknownKey(Invalid, KeyError):
    """Key that a recording does not have, or a short name of several; a KeyError, too."""

    __str__ = Exception.__str__  # that of KeyError shows the quoted text


class Recording(dict[str, Columns]):
    """Arrays of a recording by key; an unambiguous end of a key does, e.g. `pose` for `uav/pose`.

    Iteration, `in` and `get` know the whole keys only. `problem` names in words what of the file
    could not be read, e.g. `cut: it ends in the middle`; it is empty for a sound one.
    """

    problem = ""

    def __missing__(self, name: str) -> Columns:
        ends = [key for key in self if key.endswith(f"/{name}")]
        if len(ends) == 1:
            return self[ends[0]]
        if ends:
            raise UnknownKey(f"{name} is the end of several keys", f"name one: {', '.join(ends)}")
        hint = nearest(str(name), [*self, *(key.partition("/")[2] for key in self)])
        raise UnknownKey(
            f"the recording has no key {name}", hint or f"its keys are {', '.join(self)}"
        )

    def __repr__(self) -> str:
        times = [columns["received"] for columns in self.values()]
        begin, end = (min(map(np.min, times)), max(map(np.max, times))) if times else (0.0, 0.0)
        counts = (f"{key} ({len(columns['received'])})" for key, columns in self.items())
        problem = f"; it is {self.problem}" if self.problem else ""
        return f"<recording of {end - begin:.1f} s: {', '.join(counts) or 'empty'}{problem}>"


def read(file: str | os.PathLike[str]) -> Recording:
    """Read a recording into arrays by key and field.

    `read("flight.mcap")["uav/pose"]["position"]`, or `["pose"]` with one vehicle, has shape (n, 3):
    the components of a vector stand in the order of the message, x, y, z or w, x, y, z. Numbers
    have shape (n,), and so have texts and lists, as objects. Units are those of the message.
    Raises Invalid for an unreadable file.
    """
    rows: dict[str, list[Any]] = {}
    times: dict[str, list[int]] = {}
    argument("file", file, (str, os.PathLike), "the path of a recording")
    argument("file", os.fspath(file), str, "the path of a recording")
    bag = Bag(Path(file))
    for message in bag.messages(lambda channel: DERIVED not in channel.metadata):
        rows.setdefault(message.key, []).append(message.value)
        times.setdefault(message.key, []).append(message.at)
    recording = Recording(
        {
            key: _columns(values) | {"received": np.array(times[key]) / 1e9}
            for key, values in rows.items()
        }
    )
    recording.problem = bag.problem
    return recording


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
            with suppress(OverflowError):  # an int with more than 308 digits
                return np.array([list(value.values()) for value in values], dtype=float)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def _is_vector(value: dict[str, Any]) -> bool:
    return bool(value) and all(type(part) in {int, float} for part in value.values())
