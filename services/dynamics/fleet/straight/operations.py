"""What a straight line is made of: operations on one number for each vehicle, and their places."""

from dataclasses import dataclass
from typing import Literal

INPUT = "input"
"""A number that is there from the start."""
COPY = "copy"
"""The same number in another place."""
SELECT = "select"
"""The second operand where the first, a mask, is true, else the third."""

MASKS = frozenset(
    {
        "equal", "greater", "greater_equal", "less", "less_equal", "logical_and", "logical_or",
        "not_equal",
    }
)  # fmt: skip
"""Operations, by numpy's names, that make a truth value for each vehicle, not a number."""


@dataclass(frozen=True, eq=False)
class Operation:
    """One operation by its numpy name, or one of the three above; also stands for what it makes."""

    name: str
    operands: tuple["Operand", ...] = ()


Operand = Operation | float
"""What an operation made, or a number that all vehicles have in common."""


Kind = Literal["row", "work", "mask"]
"""Of a place: a row of the caller's, or one to work in, for a number or a truth value."""


@dataclass(frozen=True)
class Register:
    """A place for one number, or truth value, of each vehicle."""

    kind: Kind
    number: int

    def __str__(self) -> str:
        return f"{self.kind}{self.number}"
