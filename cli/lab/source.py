"""Source of a node: its syntax tree, the places of nodes in the text, and faults put in there. Pure."""

import ast
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from quadctl.cli.lab.effects import Effects

_NOISE = re.compile("uniform|gauss|normal|random|rng", re.IGNORECASE)
"""Call of a sensor's noise, of which neither sign nor size matters."""
_LOGS = re.compile(r"\bprint$|\blog(ger|ging)?\b")
"""Call that writes for people."""
_WIDEST, _LONGEST = 60, 120
"""Most characters of an expression that is shown around a fault, and of what is shown at all."""


class CodeFault(NamedTuple):
    """Text in place of that from the begin of `first` to the end of `last`; `about` is shown for it, if given."""

    first: ast.AST
    last: ast.AST
    text: str
    about: tuple[str, str] | None = None


class Source:
    """Source with its syntax tree, and the places of nodes in the text."""

    def __init__(self, source: str) -> None:
        self.tree = ast.parse(source)
        self.effects = Effects(self.tree)
        self.parents = {
            child: node for node in ast.walk(self.tree) for child in ast.iter_child_nodes(node)
        }
        # Columns of the tree count bytes.
        self._data = source.encode()
        lines = self._data.splitlines(keepends=True)
        self._starts = [sum(map(len, lines[:n])) for n in range(len(lines) + 1)]

    def text(self, first: ast.AST, last: ast.AST) -> str:
        """Return the text from the begin of a node to the end of another."""
        return self._data[self._begin(first) : self._end(last)].decode()

    def between(self, first: ast.AST, second: ast.AST) -> str:
        """Return the text between two nodes."""
        return self._data[self._end(first) : self._begin(second)].decode()

    def with_fault(self, fault: CodeFault) -> tuple[int, str, str, str]:
        """Return the line of a fault, what is shown without and with it, and the whole source with it."""
        begin, end = self._begin(fault.first), self._end(fault.last)
        before, after = self._data[:begin].decode(), self._data[end:].decode()
        line = getattr(fault.first, "lineno", 1)
        if fault.about:
            return line, *fault.about, before + fault.text + after
        shown = self._shown(fault)
        lead = self._data[self._begin(shown[0]) : begin].decode()
        rest = self._data[end : self._end(shown[1])].decode()
        old, new = lead + self.text(fault.first, fault.last) + rest, lead + fault.text + rest
        return line, on_a_line(old), on_a_line(new), before + fault.text + after

    def _shown(self, fault: CodeFault) -> tuple[ast.AST, ast.AST]:
        """Return the nodes that begin and end what is shown of a fault: an expression and those around it."""
        shown = fault.first
        if not isinstance(shown, ast.expr):
            return fault.first, fault.last
        while shown is not fault.last and shown not in self._above(fault.last):
            shown = self.parents[shown]
        while (around := self.parents.get(shown)) is not None:
            if not isinstance(around, (ast.expr, ast.keyword, ast.Return, ast.Assign)):
                break
            if len(on_a_line(self.text(around, around))) > _WIDEST:
                break
            shown = around
        return shown, shown

    def is_set_up(self, node: ast.AST) -> bool:
        """Return whether a node is outside functions, in a constructor, or before a function's main loop.

        Without such a statement nothing would start.
        """
        for outer in self._above(node):
            if isinstance(outer, ast.FunctionDef):
                loops = [each for each in outer.body if isinstance(each, (ast.For, ast.While))]
                before = bool(loops) and getattr(node, "lineno", 0) < loops[-1].lineno
                return outer.name == "__init__" or (before and self.parents[node] is outer)
        return True

    def is_outside(self, node: ast.AST) -> bool:
        """Return whether a node is in no function: it only starts the node."""
        return not any(isinstance(outer, ast.FunctionDef) for outer in self._above(node))

    def nodes(self) -> list[ast.AST]:
        """Return the nodes on which the flight depends: without noise of a sensor, and words for people."""
        found: list[ast.AST] = [self.tree]
        for node in found:
            found += [child for child in ast.iter_child_nodes(node) if not _is_idle(child)]
        return found

    def _above(self, node: ast.AST) -> Iterator[ast.AST]:
        while (outer := self.parents.get(node)) is not None:
            yield outer
            node = outer

    def swapped(self, left: ast.AST, right: ast.AST, old: str, new: str) -> CodeFault:
        """Return the fault of another operator between two operands."""
        gap = re.sub(rf"(?<![<>=\w]){old}(?![=\w])", new, self.between(left, right), count=1)
        return CodeFault(left, right, self.text(left, left) + gap + self.text(right, right))

    def in_place_of(self, node: ast.AST, new: ast.expr) -> CodeFault:
        """Return the fault of another expression in the place of a node."""
        text = ast.unparse(new)
        parent = self.parents[node]
        around = 0 if _lists(parent, node) or self._is_in_brackets(node) else _rank(parent)
        return CodeFault(node, node, f"({text})" if _rank(new) <= around else text)

    def _is_in_brackets(self, node: ast.AST) -> bool:
        begin, end = self._begin(node), self._end(node)
        return self._data[begin - 1 : begin] == b"(" and self._data[end : end + 1] == b")"

    def _begin(self, node: Any) -> int:
        line: int = self._starts[node.lineno - 1]
        return line + int(node.col_offset)

    def _end(self, node: Any) -> int:
        line: int = self._starts[node.end_lineno - 1]
        return line + int(node.end_col_offset)


def on_a_line(text: str) -> str:
    """Return code on one line without comments, as it is shown."""
    words = " ".join(re.sub(r"\s#.*", "", text).split())
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 3]}..."


def _rank(node: ast.AST) -> int:
    """Return how closely an expression binds; 0 for what needs no parentheses inside or around it."""
    match node:
        case ast.IfExp():
            return 1
        case ast.BoolOp():
            return 2
        case ast.UnaryOp(op=ast.Not()):
            return 3
        case ast.Compare():
            return 4
        case ast.BinOp(op=ast.Add() | ast.Sub()):
            return 5
        case ast.BinOp(op=ast.Mult() | ast.Div() | ast.FloorDiv() | ast.Mod()):
            return 6
        case ast.UnaryOp():
            return 7
        case ast.BinOp():
            return 8
        case ast.Attribute() | ast.Subscript() | ast.Call():
            return 9
        case ast.Name() | ast.Constant():
            return 10
    return 0


def _lists(parent: ast.AST, node: ast.AST) -> bool:
    """Return whether a node is an argument or an index, which brackets end."""
    return (isinstance(parent, ast.Call) and parent.func is not node) or (
        isinstance(parent, ast.Subscript) and parent.slice is node
    )


def _is_idle(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or is_noise(node) or _calls(node, _LOGS)


def is_noise(node: ast.AST) -> bool:
    """Return whether a node is a call of a sensor's noise."""
    return _calls(node, _NOISE)


def _calls(node: ast.AST, names: re.Pattern[str]) -> bool:
    return isinstance(node, ast.Call) and bool(names.search(ast.unparse(node.func)))
