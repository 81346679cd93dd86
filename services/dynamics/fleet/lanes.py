"""Values that hold one number for each vehicle, or one for all: arrays, floats, tuples of them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.bool_]
Lanes = npt.NDArray[np.intp]
Value = Any
"""An array of one float per vehicle, a float for all of them, or a tuple of values."""


def select(chosen: Mask | bool, one: Value, other: Value) -> Value:
    """`one if chosen else other`, for each vehicle."""
    if isinstance(chosen, (bool, np.bool_)):
        return one if chosen else other
    return np.where(chosen, one, other)


def branch(
    chosen: Mask | bool,
    then: Callable[..., tuple[Value, ...]],
    other: Callable[..., tuple[Value, ...]] | None,
    given: tuple[Value, ...],
    before: tuple[Value, ...],
) -> Value:
    """What `then` makes of the vehicles chosen, and `other` of the others, or what they had."""
    if isinstance(chosen, (bool, np.bool_)):
        if chosen:
            return then(*given)
        return other(*given) if other else before
    picked = np.flatnonzero(chosen)
    if picked.size == chosen.size:
        return then(*given)
    if other is None:
        if not picked.size:
            return before
        return put(before, picked, then(*pick(given, picked)), chosen.size)
    if not picked.size:
        return other(*given)
    left = np.flatnonzero(~chosen)
    rest = put(before, left, other(*pick(given, left)), chosen.size)
    return put(rest, picked, then(*pick(given, picked)), chosen.size)


def pick(value: Value, lanes: Lanes) -> Value:
    """The same of some vehicles alone."""
    if isinstance(value, tuple):
        return tuple(pick(part, lanes) for part in value)
    return value[lanes] if isinstance(value, np.ndarray) else value


def put(value: Value, lanes: Lanes, new: Value, count: int) -> Value:
    """The same with new numbers for some vehicles of so many."""
    if isinstance(value, tuple):
        return tuple(put(a, lanes, b, count) for a, b in zip(value, new, strict=True))
    if value is new:
        return value
    out = value.copy() if isinstance(value, np.ndarray) else np.full(count, value, dtype=float)
    out[lanes] = new
    return out
