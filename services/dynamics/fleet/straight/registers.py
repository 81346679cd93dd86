"""Where each operation of a straight line leaves what it makes: in as few places as can be.

A place is taken again as soon as nothing needs what is in it, the latest one first, which is the
one most likely in the processor's first cache.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from services.dynamics.fleet.straight.operations import (
    COPY,
    INPUT,
    MASKS,
    SELECT,
    Kind,
    Operation,
    Register,
)


@dataclass(frozen=True)
class Instruction:
    """An operation on what is in these places, or on a float, and the place for what it makes."""

    name: str
    operands: tuple[Register | float, ...]
    target: Register


def allocate(
    line: Sequence[Operation],
    inputs: Mapping[Operation, Register],
    results: Mapping[Operation, Register],
) -> list[Instruction]:
    """The line with its places: inputs are found in theirs, and results end in theirs.

    An input that is a result can be that of its own place alone. Other inputs stay where they are,
    unless a result ends there.
    """
    places = dict(inputs)
    pool = _Pool()
    last = {needed: at for at, operation in enumerate(line) for needed in _needs(operation)}
    last |= dict.fromkeys(results, len(line))
    held = {place for value, place in inputs.items() if value in last}
    instructions = []
    for at, operation in enumerate(line):
        if operation.name == INPUT:
            continue
        ends = [places[needed] for needed in _needs(operation) if last[needed] == at]
        spare = [place for place in ends if _may_write(operation, place, places)]
        kind: Kind = "mask" if operation.name in MASKS else "work"
        home = results.get(operation)
        if home and (home in spare or home not in held):
            target = home
        else:
            target = next((place for place in spare if place.kind == kind), None) or pool.take(kind)
        operands = tuple(places[x] if isinstance(x, Operation) else x for x in operation.operands)
        instructions.append(Instruction(operation.name, operands, target))
        places[operation] = target
        held -= set(ends)
        held.add(target)
        pool.give(place for place in ends if place != target)
    instructions += [
        Instruction(COPY, (places[value],), home)
        for value, home in results.items()
        if places[value] != home
    ]
    return instructions


def _needs(operation: Operation) -> list[Operation]:
    """What an operation is done on, each once."""
    return list(dict.fromkeys(x for x in operation.operands if isinstance(x, Operation)))


def _may_write(operation: Operation, place: Register, places: Mapping[Operation, Register]) -> bool:
    """Whether it may write into the place of an operand, as what goes element by element may.

    A selection is written in two strokes, the second value and over it the first.
    """
    if operation.name != SELECT:
        return True
    other = operation.operands[2]
    return isinstance(other, Operation) and places[other] == place


class _Pool:
    """The places to work in, those that nobody holds to be taken again, the latest first."""

    def __init__(self) -> None:
        self._free: dict[Kind, list[Register]] = {"work": [], "mask": []}
        self._made: Counter[Kind] = Counter()

    def take(self, kind: Kind) -> Register:
        if self._free[kind]:
            return self._free[kind].pop()
        self._made[kind] += 1
        return Register(kind, self._made[kind] - 1)

    def give(self, places: Iterable[Register]) -> None:
        for place in places:
            if place.kind in self._free:
                self._free[place.kind].append(place)
