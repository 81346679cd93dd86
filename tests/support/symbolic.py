"""Symbolic execution of real functions: each path through them, with an SMT solver's conditions.

A function runs as it is, on unknown values. An unknown truth value that is asked for (`if`, `and`,
`not`) takes both branches that the conditions so far allow: the function runs again for each.
Unknown numbers are IEEE doubles, with NaN, infinities and both zeros: comparisons, signs, sums and
differences are exact. Of products, quotients and opaque functions only this is known: equal
arguments give equal results. Texts are opaque; a comparison of one may come out either way.
"""

from collections.abc import Callable, Iterator
from enum import EnumType
from itertools import product
from math import isinf
from struct import unpack
from types import NoneType, UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

import z3
from msgspec import Struct
from msgspec.structs import asdict

T = TypeVar("T")
OPAQUE: dict[Any, Callable[[], Iterator[Any]]] = {}
"""Values of types that are not looked into."""
FLOAT = z3.Float64()


class Truth:
    """Unknown truth value."""

    def __init__(self, term: z3.BoolRef | None = None) -> None:
        self.term = _fresh(z3.BoolSort()) if term is None else term

    def __bool__(self) -> bool:
        assert _Path.current is not None, "an unknown is asked for outside a path"
        return _Path.current.decide(self.term)

    def __and__(self, other: object) -> "Truth":
        return Truth(z3.And(self.term, term(other)))

    def __eq__(self, other: object) -> Any:
        return Truth(self.term == term(other))

    __hash__ = None  # type: ignore[assignment]


class Number:
    """Unknown double."""

    def __init__(self, term: z3.FPRef | None = None) -> None:
        self.term = _fresh(FLOAT) if term is None else term

    def __lt__(self, other: object) -> Truth:
        return Truth(z3.fpLT(self.term, term(other)))

    def __le__(self, other: object) -> Truth:
        return Truth(z3.fpLEQ(self.term, term(other)))

    def __gt__(self, other: object) -> Truth:
        return Truth(z3.fpGT(self.term, term(other)))

    def __ge__(self, other: object) -> Truth:
        return Truth(z3.fpGEQ(self.term, term(other)))

    def __eq__(self, other: object) -> Any:
        return Truth(z3.fpEQ(self.term, term(other)))

    __hash__ = None  # type: ignore[assignment]

    def __neg__(self) -> "Number":
        return Number(-self.term)

    def __add__(self, other: object) -> "Number":
        if isinstance(other, float) and isinf(other):
            return Number(z3.fpAdd(z3.RNE(), self.term, term(other)))
        return opaque("sum", self, other)

    __radd__ = __add__

    def __sub__(self, other: object) -> "Number":
        return opaque("difference", self, other)

    def __rsub__(self, other: object) -> "Number":
        return opaque("difference", other, self)

    def __mul__(self, other: object) -> "Number":
        return opaque("product", self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: object) -> "Number":
        return opaque("quotient", self, other)

    def __rtruediv__(self, other: object) -> "Number":
        return opaque("quotient", other, self)

    def __abs__(self) -> "Number":
        return Number(z3.fpAbs(self.term))

    def __format__(self, _spec: str) -> str:
        return "nan"

    def __bool__(self) -> bool:
        return bool(Truth(z3.Not(z3.fpIsZero(self.term))))

    __repr__ = __str__ = lambda _self: "nan"


class Text:
    """Unknown text."""

    def __eq__(self, other: object) -> Any:
        return other is self or Truth()

    __hash__ = None  # type: ignore[assignment]

    def __bool__(self) -> bool:
        return bool(Truth())

    def removeprefix(self, _prefix: str) -> "Text":
        return Text()


def term(value: object) -> Any:
    """Return the solver's term of a known or unknown number or truth value."""
    match value:
        case Truth() | Number():
            return value.term
        case bool():
            return z3.BoolVal(value)
        case _:
            return z3.FPVal(value, FLOAT)


def opaque(name: str, *arguments: object) -> Number:
    """Return any number, the same for the same arguments."""
    function = z3.Function(name, *[FLOAT] * (len(arguments) + 1))
    return Number(function(*map(term, arguments)))


def unknown(kind: Any) -> Iterator[Any]:
    """Yield unknown values of a type that together are all of its values: one for each shape."""
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    if kind in OPAQUE:
        yield from OPAQUE[kind]()
    elif get_origin(kind) in {Union, UnionType}:
        for each in get_args(kind):
            yield from unknown(each)
    elif get_origin(kind) is tuple:
        # Of a tuple of any length code may take the first from the rest: two are enough to see it.
        each, *others = get_args(kind)
        lengths = ((each,) * n for n in range(3)) if others == [...] else ((each, *others),)
        for kinds in lengths:
            yield from product(*(list(unknown(part)) for part in kinds))
    elif isinstance(kind, EnumType):
        yield from kind
    elif isinstance(kind, type) and issubclass(kind, Struct):
        hints = get_type_hints(kind, include_extras=True).values()
        for fields in product(*(list(unknown(hint)) for hint in hints)):
            yield kind(*fields)
    else:
        shapes: dict[Any, Callable[[], Any]] = {
            bool: Truth, float: Number, int: Number, str: Text, NoneType: lambda: None
        }  # fmt: skip
        yield shapes[kind]()


class _Path:
    """Decisions on the way through a function, and those still to be tried.

    The solver has a level for each decision. The next path to be tried differs from this one in its
    last decision alone, so that the solver keeps all levels below, with all it has learnt there.
    """

    current: "_Path | None" = None

    def __init__(self, solver: z3.Solver, taken: list[bool], waiting: list[list[bool]]) -> None:
        self._solver, self._taken, self._waiting, self._next = solver, taken, waiting, 0
        self._known: dict[z3.BoolRef, bool] = {}
        self._model: z3.ModelRef | None = None
        self._unknowns = 0
        solver.pop(solver.num_scopes() - max(len(taken) - 1, 0))

    def fresh(self, sort: z3.SortRef) -> Any:
        """Return an unknown: the same again on a path that is the same so far."""
        self._unknowns += 1
        return z3.Const(f"path!{self._unknowns}!{sort}", sort)

    def decide(self, condition: z3.BoolRef) -> bool:
        """Return a truth value that the conditions so far allow; leave the other one waiting."""
        condition = z3.simplify(condition)
        if z3.is_true(condition) or z3.is_false(condition):
            return z3.is_true(condition)
        if condition in self._known:
            return self._known[condition]
        if self._next == len(self._taken):
            if self._model is None:
                possible(self._solver)
                self._model = self._solver.model()
            choice = z3.is_true(self._model.eval(condition, model_completion=True))
            if possible(self._solver, z3.Not(condition) if choice else condition):
                self._waiting.append([*self._taken, not choice])
            self._taken.append(choice)
        choice = self._taken[self._next]
        self._next += 1
        self._known[condition] = choice
        if self._next > self._solver.num_scopes():
            self._solver.push()
            self._solver.add(condition if choice else z3.Not(condition))
        return choice


def _fresh(sort: z3.SortRef) -> Any:
    return _Path.current.fresh(sort) if _Path.current else z3.FreshConst(sort)


def possible(solver: z3.Solver, *conditions: z3.BoolRef) -> bool:
    """Return whether conditions can hold on a path; raise RuntimeError if the solver gives up."""
    found = solver.check(*conditions)
    if found == z3.unknown:
        raise RuntimeError(f"the solver gave up: {solver.reason_unknown()}")
    return bool(found == z3.sat)


def violation(solver: z3.Solver, clause: z3.BoolRef) -> z3.ModelRef | None:
    """Return values for which a clause is false on a path; None if there are none."""
    return solver.model() if possible(solver, z3.Not(clause)) else None


def known(model: z3.ModelRef, value: Any) -> Any:
    """Return a value with the model's values for the unknown ones in it."""
    match value:
        case Number():
            bits = model.eval(z3.fpToIEEEBV(value.term), model_completion=True)
            return unpack(">d", bits.as_long().to_bytes(8, "big"))[0]
        case Truth():
            return z3.is_true(model.eval(value.term, model_completion=True))
        case Text():
            return ""
        case tuple():
            return tuple(known(model, each) for each in value)
        case Struct():
            fields = {name: known(model, each) for name, each in asdict(value).items()}
            return type(value)(**fields)
    return value


def paths(given: list[z3.BoolRef], run: Callable[[], T]) -> Iterator[tuple[z3.Solver, T]]:
    """Yield the result of each path through a function, and a solver with its conditions."""
    waiting: list[list[bool]]
    solver, waiting = z3.SolverFor("QF_FP"), [[]]
    solver.add(given)
    if not possible(solver):
        return
    while waiting:
        _Path.current = _Path(solver, waiting.pop(), waiting)
        try:
            found = run()
        finally:
            _Path.current = None
        yield solver, found
