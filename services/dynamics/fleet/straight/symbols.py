"""Numbers that write down what is done with them, for the model's text to be run on.

What is known while the text is read (a constant of all vehicles) is a float and computed at once,
as it would be in flight. The same operation on the same operands is written down once.
"""

import math
from collections.abc import Callable

from services.dynamics.fleet.straight.operations import INPUT, SELECT, Operand, Operation
from services.dynamics.fleet.trees import Tree
from services.dynamics.fleet.vectorise import on_arrays


def traced(name: str) -> Callable[..., Tree]:
    """A function of the model's text (`rigidbody_step` is `rigidbody.step`) for symbols and floats."""
    return on_arrays(name, sqrt=_sqrt, select=_select, branch=_branch)


class Book:
    """What was written down so far."""

    def __init__(self) -> None:
        """Nothing."""
        self._known: dict[tuple[object, ...], Symbol] = {}

    def input(self) -> "Symbol":
        """A number that is there from the start."""
        return Symbol(self, Operation(INPUT))

    def write(self, name: str, *operands: Tree) -> Tree:
        """What this operation makes of symbols and floats."""
        # Both are the same number to the bit, also where it is -0.0.
        if name == "subtract" and _is_zero(operands[1]):
            return operands[0]
        if name == SELECT and operands[1] is operands[2]:
            return operands[1]
        values = tuple(_value(operand) for operand in operands)
        # By its text a float is told from its negative also where it is 0.
        key = (name, *(v if isinstance(v, Operation) else repr(v) for v in values))
        if key not in self._known:
            self._known[key] = Symbol(self, Operation(name, values))
        return self._known[key]


def _is_zero(operand: Tree) -> bool:
    return isinstance(operand, float) and repr(operand) == "0.0"


def _value(operand: Tree) -> Operand:
    return operand.operation if isinstance(operand, Symbol) else float(operand)


def _operator(name: str) -> Callable[["Symbol", Tree], Tree]:
    return lambda self, other: self.book.write(name, self, other)


def _reflected(name: str) -> Callable[["Symbol", Tree], Tree]:
    return lambda self, other: self.book.write(name, other, self)


class Symbol:
    """A number, or a truth value, that each vehicle has one of."""

    def __init__(self, book: Book, operation: Operation) -> None:
        """As `operation` makes it."""
        self.book, self.operation = book, operation

    def __bool__(self) -> bool:
        raise TypeError(f"whether {self.operation.name} holds is not the same for all vehicles")

    def __neg__(self) -> Tree:
        return self.book.write("negative", self)

    def __abs__(self) -> Tree:
        return self.book.write("absolute", self)

    def __and__(self, other: Tree) -> Tree:
        if isinstance(other, Symbol):
            return self.book.write("logical_and", self, other)
        return self if other else False

    def __or__(self, other: Tree) -> Tree:
        if isinstance(other, Symbol):
            return self.book.write("logical_or", self, other)
        return True if other else self

    __rand__, __ror__ = __and__, __or__
    __hash__ = object.__hash__
    __add__, __radd__ = _operator("add"), _reflected("add")
    __sub__, __rsub__ = _operator("subtract"), _reflected("subtract")
    __mul__, __rmul__ = _operator("multiply"), _reflected("multiply")
    __truediv__, __rtruediv__ = _operator("divide"), _reflected("divide")
    __lt__, __le__ = _operator("less"), _operator("less_equal")
    __gt__, __ge__ = _operator("greater"), _operator("greater_equal")
    __eq__, __ne__ = _operator("equal"), _operator("not_equal")


def _sqrt(x: Tree) -> Tree:
    return x.book.write("sqrt", x) if isinstance(x, Symbol) else math.sqrt(x)


def _select(chosen: Tree, one: Tree, other: Tree) -> Tree:
    if not isinstance(chosen, Symbol):
        return one if chosen else other
    if isinstance(one, tuple):
        return tuple(_select(chosen, a, b) for a, b in zip(one, other, strict=True))
    return chosen.book.write(SELECT, chosen, one, other)


def _branch(
    chosen: Tree,
    then: Callable[..., Tree],
    other: Callable[..., Tree] | None,
    given: Tree,
    before: Tree,
) -> Tree:
    """As `lanes.branch`, but where vehicles differ all take both sides."""
    if not isinstance(chosen, Symbol):
        if chosen:
            return then(*given)
        return other(*given) if other else before
    return _select(chosen, then(*given), other(*given) if other else before)
