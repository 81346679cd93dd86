"""A straight line as a Python function of numpy calls."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from services.dynamics.fleet.storage import Numbers
from services.dynamics.fleet.straight.operations import COPY, MASKS, SELECT, Register
from services.dynamics.fleet.straight.registers import Instruction

_FUNCTIONS = (
    "absolute", "add", "copyto", "divide", "multiply", "negative", "sqrt", "subtract", *sorted(MASKS),
)  # fmt: skip
"""Of numpy, what a straight line calls."""


@dataclass(frozen=True)
class Program:
    """What was made of a function."""

    run: Callable[[Numbers, Numbers, npt.NDArray[np.bool_], int], None]
    """Runs it on rows, of which results take the places, so many times; work rows and mask rows
    (of bool) are scratch space of the same length."""
    source: str
    works: int
    """Work rows that it needs."""
    masks: int
    """Mask rows that it needs."""


def emit(instructions: Sequence[Instruction]) -> Program:
    """The function that does these."""
    registers = {x for each in instructions for x in (*each.operands, each.target)}
    rows, works, masks = (
        sorted({r.number for r in registers if isinstance(r, Register) and r.kind == kind})
        for kind in ("row", "work", "mask")
    )
    numbers: dict[str, str] = {}

    def named(operand: Register | float) -> str:
        # As an array without dimensions, for numpy takes those faster than floats.
        if isinstance(operand, Register):
            return str(operand)
        return numbers.setdefault(repr(operand), f"number{len(numbers)}")

    lines = [line for each in instructions for line in _calls(each, named)]
    source = "\n".join(
        [
            "def run(row, work, mask, times):",
            *(f"    row{i} = row[{i}]" for i in rows),
            *(f"    work{i} = work[{i}]" for i in works),
            *(f"    mask{i} = mask[{i}]" for i in masks),
            "    for _ in range(times):",
            *(f"        {line}" for line in lines or ["pass"]),
            "",
        ]
    )
    found: dict[str, Any] = {name: np.array(float(text)) for text, name in numbers.items()}
    found |= {name: getattr(np, name) for name in _FUNCTIONS}
    exec(compile(source, "<a straight line>", "exec"), found)  # noqa: S102 - our own text
    return Program(found["run"], source, len(works), len(masks))


def _calls(each: Instruction, named: Callable[[Register | float], str]) -> list[str]:
    """The calls of numpy for an instruction."""
    target, operands = str(each.target), [named(operand) for operand in each.operands]
    if each.name == COPY:
        return [f"copyto({target}, {operands[0]})"]
    if each.name != SELECT:
        return [f"{each.name}({', '.join(operands)}, {target})"]
    mask, one, other = operands
    first = [] if other == target else [f"copyto({target}, {other})"]
    return [*first, f"copyto({target}, {one}, where={mask})"]
