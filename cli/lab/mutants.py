"""Mutants of a student's node: copies of its source with a single fault each, as students make them. Pure.

A comment `# equivalent OPERATOR: reason`, on a line or above it, lists the mutants by that operator on that
line as equivalent: right as well, though they differ.
"""

import ast
import inspect
import re
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any, Literal, get_args

import msgspec
from msgspec import Struct

from quadctl.cli.lab.effects import name_of
from quadctl.cli.lab.source import CodeFault, Source, is_noise, on_a_line
from quadctl.schemas import messages, services
from quadctl.schemas.typeinfo import described
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.names import nearest

Operator = Literal[
    "compare", "bound", "axis", "sign", "order", "missing transition", "missing publish",
    "wrong unit", "early", "late", "twice", "never",
]  # fmt: skip
OPERATORS: tuple[Operator, ...] = get_args(Operator)
_OFFSET = 0.3
"""Metres by which a bound is moved: less than the default acceptance range."""
_RANGE = re.compile("range|reach|radius|toleran|eps", re.IGNORECASE)
"""Name of the distance at which a goal counts as reached."""
_FREE = {"samples", "spread"}
"""Fields that LAB.md leaves open."""
_ORDERS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
_Swaps = dict[type[ast.cmpop], tuple[str, str]]
_EQUAL: _Swaps = {
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: (r"is\s+not", "is"),
}
_CLOSED: _Swaps = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
}
_TURNED: _Swaps = {
    ast.Lt: ("<", ">"),
    ast.LtE: ("<=", ">="),
    ast.Gt: (">", "<"),
    ast.GtE: (">=", "<="),
}
_NEXT_AXIS = {"x": "y", "y": "z", "z": "x"}
_EQUIVALENT = re.compile(r"#\s*equivalent ([\w ]+): (.+)")


class Mutant(Struct, frozen=True):
    """Source with one fault; `equivalent` is the reason why that is none, else empty."""

    name: str
    operator: Operator
    line: int
    old: str
    new: str
    source: str
    equivalent: str = ""


def mutants(source: str, file: str) -> list[Mutant]:
    """Return the mutants of a source, by line; raise Invalid for a source or comment that cannot be read."""
    try:
        code = Source(source)
        reasons = _reasons(source, file)
    except (SyntaxError, tokenize.TokenError, ValueError) as error:
        raise Invalid(f"{file}: {error}", "mutants are made of a node that runs") from error
    found: list[Mutant] = []
    seen, names = {source}, Counter[str]()
    nodes = code.nodes()
    for operator in OPERATORS:
        for node in nodes:
            for fault in _FAULTS[operator](code, node):
                line, old, new, mutated = code.with_fault(fault)
                if mutated in seen:
                    continue
                seen.add(mutated)
                name = f"{file}:{line} {operator}: {old} -> {new}"
                names[name] += 1
                # Two places of a line may look the same.
                name += f" ({names[name]})" if names[name] > 1 else ""
                reason = reasons.get((line, operator), "")
                found.append(Mutant(name, operator, line, old, new, mutated, reason))
    return sorted(found, key=lambda mutant: mutant.line)


def _reasons(source: str, file: str) -> dict[tuple[int, str], str]:
    """Return the reasons for equivalence by line and operator; raise Invalid for an unknown operator."""
    found: dict[tuple[int, str], str] = {}
    waiting: list[tuple[str, str]] = []
    skipped = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    last = 0
    for token in tokenize.generate_tokens(iter(source.splitlines(keepends=True)).__next__):
        if token.type == tokenize.COMMENT:
            if not (comment := _EQUIVALENT.match(token.string)):
                continue
            operator, reason = comment.groups()
            if operator not in OPERATORS:
                hint = nearest(operator, OPERATORS) or f"one of {', '.join(OPERATORS)}"
                raise Invalid(f"{file}:{token.start[0]}: there is no operator {operator}", hint)
            if token.start[0] == last:
                found[last, operator] = reason
            else:
                waiting.append((operator, reason))
        elif token.type not in skipped:
            last = token.end[0]
            found |= {(token.start[0], operator): reason for operator, reason in waiting}
            waiting.clear()
    return found


def _is_range(node: ast.AST) -> bool:
    """Return whether a node compares a distance with the acceptance range."""
    return (
        isinstance(node, ast.Compare)
        and len(node.ops) == 1
        and isinstance(node.ops[0], _ORDERS)
        and any(_RANGE.search(ast.unparse(side)) for side in (node.left, *node.comparators))
    )


def _compare(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if code.is_outside(node):
        return
    if isinstance(node, ast.BoolOp):
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in pairwise(node.values):
            yield code.swapped(left, right, old, new)
    elif isinstance(node, ast.Compare):
        # A distance is never equal to the range.
        table = _EQUAL | (_TURNED if _is_range(node) else _CLOSED)
        for op, (left, right) in zip(
            node.ops, pairwise([node.left, *node.comparators]), strict=True
        ):
            if type(op) in table:
                yield code.swapped(left, right, *table[type(op)])


def _bound(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if isinstance(node, ast.Compare) and not _is_range(node):
        sides = [node.left, *node.comparators]
        constants = [side for side in sides if isinstance(side, ast.Constant)]
        bounds = [sides[0], sides[-1]] if len(sides) > 2 else (constants or sides)[-1:]
        for bound in bounds if all(isinstance(op, _ORDERS) for op in node.ops) else []:
            for op in (ast.Add(), ast.Sub()):
                moved = ast.BinOp(bound, op, ast.Constant(_OFFSET))
                yield code.in_place_of(bound, moved)
    elif isinstance(node, ast.Call):
        for argument, is_float in _fields(node):
            if is_float and _is_zero(argument):
                yield code.in_place_of(argument, ast.Constant(1.0))
    elif isinstance(node, ast.Constant):
        parent = code.parents[node]
        if _is_zero(node) and isinstance(node.value, float):
            if isinstance(parent, (ast.IfExp, ast.Assign, ast.AnnAssign, ast.Tuple)):
                yield code.in_place_of(node, ast.Constant(1.0))
        elif _counts(parent, node):
            yield code.in_place_of(node, _times(10, node))


def _is_zero(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in {int, float} and not node.value


def _counts(parent: ast.AST, node: ast.Constant) -> bool:
    """Return whether a constant is the length of a window, or the period of what is done now and then."""
    if type(node.value) is not int or node.value < 2:
        return False
    return (
        isinstance(parent, ast.keyword)
        or (isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Mod))
        or (isinstance(parent, ast.UnaryOp) and isinstance(parent.op, ast.USub))
        or (isinstance(parent, ast.Assign) and isinstance(parent.targets[0], ast.Name))
    )


def _axis(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
        if other := _NEXT_AXIS.get(node.attr):
            yield code.in_place_of(node, ast.Attribute(node.value, other, ast.Load()))
    elif isinstance(node, ast.Constant) and node.value == "xyz":
        yield code.in_place_of(node, ast.Constant("xyx"))


def _sign(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    match node:
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            if not isinstance(node.operand, ast.Constant):
                yield code.in_place_of(node, node.operand)
        case ast.Call(func=ast.Name("abs"), args=[inner]):
            yield code.in_place_of(node, inner)
        case ast.BinOp(left, ast.Add() | ast.Sub(), right) if not is_noise(right):
            op = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
            yield code.in_place_of(node, ast.BinOp(left, op, right))
        case ast.Constant(True | False) if not _is_option(code, node):
            yield code.in_place_of(node, ast.Constant(not node.value))


def _is_option(code: Source, node: ast.AST) -> bool:
    """Return whether a node is a named argument of a call that makes no message."""
    parent = code.parents[node]
    if not isinstance(parent, ast.keyword):
        return False
    call = code.parents[parent]
    return not isinstance(call, ast.Call) or name_of(call.func) not in _MESSAGES


def _order(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    for body in _bodies(node):
        for pair in pairwise(body):
            if _matters(code, *pair):
                yield _moved(code, pair)


def _late(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if _is_range(node):
        yield _scaled(code, node, 0.5)
    for body in _bodies(node):
        end = len(body) - isinstance(body[-1], ast.Return)
        for number, first in enumerate(body[:end]):
            simple = isinstance(first, (ast.Assign, ast.AugAssign, ast.Expr))
            if simple and any(_matters(code, first, each) for each in body[number + 1 : end]):
                yield _moved(code, body[number:end])


def _bodies(node: ast.AST) -> Iterator[list[ast.stmt]]:
    """Yield the lists of statements of a function, a loop or an `if`."""
    if not isinstance(node, (ast.Module, ast.ClassDef)):
        for field in ("body", "orelse"):
            if isinstance(body := getattr(node, field, None), list) and body:
                yield body


def _matters(code: Source, first: ast.stmt, second: ast.stmt) -> bool:
    """Return whether the order of two statements matters; false if the second could not run first."""
    if isinstance(second, ast.Return) or code.is_set_up(first):
        return False
    one, other = code.effects.of(first), code.effects.of(second)
    touched = one.writes & (other.reads | other.writes) or one.reads & other.writes
    return bool(touched) and not one.binds & other.reads


def _moved(code: Source, parts: Sequence[ast.stmt]) -> CodeFault:
    """Return the fault of a statement that comes after those that follow it."""
    gaps = [code.between(one, other) for one, other in pairwise(parts)]
    moved, *texts = [code.text(part, part) for part in parts]
    text = "".join(each + gap for each, gap in zip(texts, gaps, strict=True)) + moved
    old, below = (each.partition("\n")[0] for each in (moved, texts[-1]))
    return CodeFault(parts[0], parts[-1], text, (old, f"below {below}"))


def _missing_transition(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if code.is_set_up(node):
        return
    if isinstance(node, ast.Assign) and len(node.targets) == 1:
        target = node.targets[0]
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        kept = [name for name in names if code.effects.is_state(name)]
        if len(names) == 1 and kept:
            yield CodeFault(node, node, "pass")
        elif isinstance(node.value, ast.Tuple):
            for name, value in zip(names, node.value.elts, strict=False):
                if name in kept:
                    yield code.in_place_of(value, name)
    elif isinstance(node, (ast.AnnAssign, ast.AugAssign)):
        if node.value and code.effects.is_state(node.target):
            yield CodeFault(node, node, "pass")
    elif _is_call(node) and code.effects.changes_state(node):
        yield CodeFault(node, node, "pass")


def _missing_publish(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if _is_call(node) and code.effects.publishes(node) and not code.effects.changes_state(node):
        yield CodeFault(node, node, "pass")


def _is_call(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)


def _wrong_unit(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if isinstance(node, ast.Call):
        for argument, is_float in _fields(node):
            if is_float and not _is_zero(argument):
                yield code.in_place_of(argument, _times(100, argument))
    elif isinstance(node, ast.Constant) and type(node.value) is float and not _is_zero(node):
        yield code.in_place_of(node, _times(100, node))


def _early(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if _is_range(node):
        yield _scaled(code, node, 2)
        assert isinstance(node, ast.expr)  # noqa: S101 - a comparison
        yield code.in_place_of(node, ast.Constant(True))


def _scaled(code: Source, node: Any, factor: float) -> CodeFault:
    side = next(each for each in (*node.comparators, node.left) if _RANGE.search(ast.unparse(each)))
    return code.in_place_of(side, _times(factor, side))


def _times(factor: float, value: ast.expr) -> ast.expr:
    return ast.BinOp(ast.Constant(factor), ast.Mult(), value)


def _twice(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub):
        yield code.in_place_of(node, ast.BinOp(node, ast.Sub(), node.right))
    elif (isinstance(node, ast.AugAssign) and isinstance(node.op, (ast.Add, ast.Sub))) or (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Call)
        # Not of a message: one that comes twice is one.
        and name_of(node.value.func) == "append"
    ):
        text = code.text(node, node)
        about = (on_a_line(text), "twice")
        yield CodeFault(node, node, f"{text}; {ast.unparse(node)}", about)


def _never(code: Source, node: ast.AST) -> Iterator[CodeFault]:
    if isinstance(node, ast.If) and not code.is_set_up(node):
        yield code.in_place_of(node.test, ast.Constant(False))
    elif isinstance(node, ast.IfExp):
        yield code.in_place_of(node, node.orelse)


_FAULTS: dict[Operator, Callable[[Source, ast.AST], Iterator[CodeFault]]] = {
    "compare": _compare,
    "bound": _bound,
    "axis": _axis,
    "sign": _sign,
    "order": _order,
    "missing transition": _missing_transition,
    "missing publish": _missing_publish,
    "wrong unit": _wrong_unit,
    "early": _early,
    "late": _late,
    "twice": _twice,
    "never": _never,
}


def _fields(call: ast.Call) -> Iterator[tuple[ast.expr, bool]]:
    """Yield each argument of a message, and whether its field is a float with a unit."""
    fields = _MESSAGES.get(name_of(call.func), {})
    placed = [arg for arg in call.args if not isinstance(arg, ast.Starred)]
    if len(placed) == len(call.args) or isinstance(call.args[-1], ast.Starred):
        yield from zip(placed, fields.values(), strict=False)
    for keyword in call.keywords:
        yield keyword.value, fields.get(keyword.arg or "", False)


def _floats(type_: type[Struct]) -> dict[str, bool]:
    return {
        field.encode_name: isinstance(described(field.type), msgspec.inspect.FloatType)
        and field.name not in _FREE
        for field in msgspec.structs.fields(type_)
    }


_MESSAGES = {
    name: _floats(type_)
    for module in (messages, services)
    for name, type_ in inspect.getmembers(module, inspect.isclass)
    if issubclass(type_, Struct)
}
"""Fields of each message, and which of them are floats with a unit."""
