"""What is promised against a hazard, the tests that hold it, and what was last found of it."""

from typing import NamedTuple


class Last(NamedTuple):
    """A figure of the long counts: by how its proof's name begins, and of what it is.

    `of` is empty where a promise has one figure alone.
    """

    proof: str
    of: str = ""


class Promise(NamedTuple):
    """One promise; `tests` by their node ids, first those of every day."""

    hazard: str
    promise: str
    tests: tuple[str, ...]
    last: tuple[Last, ...] = ()
