"""A function of numbers as a straight line of numpy calls on rows."""

from collections.abc import Callable, Mapping, Sequence

from services.dynamics.fleet.straight.emit import Program, emit
from services.dynamics.fleet.straight.operations import COPY, Operation, Register
from services.dynamics.fleet.straight.order import ordered
from services.dynamics.fleet.straight.registers import allocate
from services.dynamics.fleet.straight.symbols import Book, Symbol
from services.dynamics.fleet.trees import Tree, flat, mapped


def program(function: Callable[..., Tree], arguments: Sequence[Tree], results: Tree) -> Program:
    """A function that can be run on symbols (`symbols.traced`), on rows.

    `arguments` and `results` are as the function takes and returns them, with a row Register for
    what differs among vehicles and a float for what they have in common. Each result goes to a row.
    """
    book = Book()
    leaves = dict.fromkeys(flat(tuple(arguments)))
    inputs = {leaf: book.input() for leaf in leaves if isinstance(leaf, Register)}
    returned = flat(function(*mapped(lambda leaf: inputs.get(leaf, leaf), tuple(arguments))))
    places = {symbol.operation: register for register, symbol in inputs.items()}
    homes: dict[Operation, Register] = {}
    for value, home in zip(returned, flat(results), strict=True):
        homes[_of_its_own(value, home, places, homes)] = home
    return emit(allocate(ordered(homes), places, homes))


def _of_its_own(
    value: Symbol | float,
    home: Register,
    inputs: Mapping[Operation, Register],
    homes: Mapping[Operation, Register],
) -> Operation:
    """What makes a result, or a copy of it where it stays elsewhere too."""
    if not isinstance(value, Symbol):
        return Operation(COPY, (value,))
    operation = value.operation
    if operation in homes or inputs.get(operation, home) != home:
        return Operation(COPY, (operation,))
    return operation
