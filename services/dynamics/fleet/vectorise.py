"""From the model's text over floats to the same text over arrays, a vehicle to each element.

A conditional expression becomes a selection, both sides computed. An `if`, which saves work, is
run on those vehicles alone that take it: their elements are picked out, and put back in the end.
"""

import ast
from collections.abc import Callable, Iterable
from functools import cache
from types import CodeType
from typing import Any

from services.dynamics.fleet.text import define, merged

_ROOTS = ("everyday_period", "everyday_remainder", "rigidbody_step")
"""What is flown on arrays; all that these call comes along."""


def on_arrays(name: str, **found: Callable[..., Any]) -> Callable[..., Any]:
    """A function of the model's text (`rigidbody_step` is `rigidbody.step`) over arrays.

    `found` is what the text calls that is not its own: `sqrt`, `select` and `branch`.
    """
    space: dict[str, Any] = dict(found)
    exec(_text(), space)  # noqa: S102 - our own text
    function: Callable[..., Any] = space[name]
    return function


@cache
def _text() -> CodeType:
    functions = [Vectorise().visit(function) for function in merged(_ROOTS)]
    tree = ast.fix_missing_locations(ast.Module(functions, []))
    return compile(tree, "<the model on arrays>", "exec")


class Vectorise(ast.NodeTransformer):
    """Rewrites one function; `select` and `branch` are what `lanes` has under these names."""

    def __init__(self) -> None:
        self._count = 0

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        """`a if c else b` to `select(c, a, b)`."""
        self.generic_visit(node)
        return ast.Call(ast.Name("select", ast.Load()), [node.test, node.body, node.orelse], [])

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Rewrite the body, knowing what has a value at each `if`."""
        node.body = self._block(node.body, {argument.arg for argument in node.args.args})
        return node

    def _block(self, body: list[ast.stmt], known: set[str]) -> list[ast.stmt]:
        out: list[ast.stmt] = []
        for statement in body:
            if isinstance(statement, ast.If):
                out += self._branch(statement, known)
                continue
            out.append(self.visit(statement))
            known |= _names([statement], ast.Store)
        return out

    def _branch(self, node: ast.If, known: set[str]) -> list[ast.stmt]:
        sides = [node.body, node.orelse] if node.orelse else [node.body]
        both = node.body + node.orelse
        given = sorted(known & _names(both, ast.Load, ast.Store))
        taken = sorted(known & _names(both, ast.Store))
        arguments = [ast.arg(name) for name in given]
        functions = []
        for side in sides:
            self._count += 1
            body = [*self._block(side, set(given)), ast.Return(_tuple(taken, ast.Load()))]
            functions.append(define(f"_side{self._count}", arguments, body))
        names = [ast.Name(function.name, ast.Load()) for function in functions]
        other = names[1] if node.orelse else ast.Constant(None)
        call = ast.Call(
            ast.Name("branch", ast.Load()),
            [
                self.visit(node.test),
                names[0],
                other,
                _tuple(given, ast.Load()),
                _tuple(taken, ast.Load()),
            ],
            [],
        )
        return [*functions, ast.Assign([_tuple(taken, ast.Store())], call)]


def _names(body: Iterable[ast.stmt], *kinds: type[ast.expr_context]) -> set[str]:
    nodes = (node for statement in body for node in ast.walk(statement))
    return {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, kinds)}


def _tuple(names: list[str], context: ast.expr_context) -> ast.Tuple:
    return ast.Tuple([ast.Name(name, context) for name in names], context)
