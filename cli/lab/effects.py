"""Effects of a node's statements: state that they read and write, and whether they publish. Pure."""

import ast
from collections.abc import Iterator
from typing import NamedTuple

_SENDS = {"put", "serve", "listen", "advance_sim_time"}
"""Methods of the kit that others notice."""
_CHANGES = {"append", "appendleft", "popleft", "pop", "clear", "extend", "update"}
"""Methods of a container that change it."""


class Touched(NamedTuple):
    """Names that a statement reads and writes; of these `binds` are local to its function."""

    reads: frozenset[str]
    writes: frozenset[str]
    binds: frozenset[str]


def name_of(node: ast.AST) -> str:
    """Return the last name of `a.b`, of `b`, or of the constant key in `a["b"]`; else empty."""
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case ast.Subscript(slice=ast.Constant(str(name))):
            return name
        case ast.Subscript(value=value):
            return name_of(value)
    return ""


class Effects:
    """Effects of the statements of one module, those of its own functions that they call included."""

    def __init__(self, tree: ast.Module) -> None:
        self._functions = dict[str, ast.FunctionDef]()
        # A name that a loop or closure keeps from one message to the next is state as an attribute is.
        self._kept = set[str]()
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                self._functions[node.name] = node
                self._kept |= _kept_in(node)
            elif isinstance(node, ast.Nonlocal):
                self._kept |= {*node.names}

    def of(self, statement: ast.stmt) -> Touched:
        """Return the names that a statement touches."""
        reads, writes = set[str](), set[str]()
        own = {*ast.walk(statement)}
        for node in self._reached(statement):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                if node.func.attr in _CHANGES:
                    writes.add(_key(node.func.value))
                elif node.func.attr == "put":
                    writes.add(f"put {_key(node.func.value)}")
            # A local name of another function is none of ours.
            elif key := _key(node) if node in own or not _is_local(node, self._kept) else "":
                (writes if _is_stored(node) else reads).add(key)
        binds = _names(statement, stored=True) - self._kept
        return Touched(frozenset(reads), frozenset(writes), frozenset(binds))

    def is_state(self, target: ast.expr) -> bool:
        """Return whether a target keeps its value from one message to the next."""
        if isinstance(target, ast.Name):
            return target.id in self._kept
        return isinstance(target, (ast.Attribute, ast.Subscript))

    def changes_state(self, statement: ast.AST) -> bool:
        """Return whether a statement writes state, also by a function that it calls."""
        return any(
            (isinstance(node, ast.expr) and _is_stored(node) and self.is_state(node))
            or (isinstance(node, ast.Call) and name_of(node.func) in _CHANGES)
            for node in self._reached(statement)
        )

    def publishes(self, statement: ast.AST) -> bool:
        """Return whether others notice a statement, also by a function that it calls."""
        return any(
            isinstance(node, ast.Call) and name_of(node.func) in _SENDS
            for node in self._reached(statement)
        )

    def _reached(self, statement: ast.AST) -> Iterator[ast.AST]:
        """Yield the nodes of a statement and of the functions that it calls."""
        waiting, seen = [statement], set[str]()
        while waiting:
            for node in ast.walk(waiting.pop()):
                yield node
                if isinstance(node, ast.Call):
                    name = name_of(node.func)
                    if name in self._functions and name not in seen:
                        seen.add(name)
                        waiting.append(self._functions[name])


def _key(node: ast.AST) -> str:
    """Return what tells a name from an attribute and from a key; empty for anything else."""
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(attr=name):
            return f".{name}"
        case ast.Subscript(slice=ast.Constant(str(name))):
            return f"[{name}]"
        case ast.Subscript(value=value):
            return _key(value)
    return ""


def _is_local(node: ast.AST, kept: set[str]) -> bool:
    return isinstance(node, ast.Name) and node.id not in kept


def _kept_in(function: ast.FunctionDef) -> set[str]:
    """Return the names that a function sets before a loop, and reads and sets in it."""
    kept, own = set[str](), [*_without_inner(function)]
    for loop in own:
        if isinstance(loop, (ast.For, ast.While)):
            before = {
                node.id
                for node in own
                if isinstance(node, ast.Name) and _is_stored(node) and node.lineno < loop.lineno
            }
            kept |= before & _names(loop, stored=True) & _names(loop, stored=False)
    return kept


def _without_inner(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """Yield the nodes of a function, without those of functions in it."""
    waiting: list[ast.AST] = [*function.body]
    while waiting:
        yield (node := waiting.pop())
        if not isinstance(node, ast.FunctionDef):
            waiting += ast.iter_child_nodes(node)


def _names(statement: ast.AST, *, stored: bool) -> set[str]:
    """Return the names in a statement that it sets, or else reads."""
    return {
        node.id
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and _is_stored(node) is stored
    }


def _is_stored(node: ast.AST) -> bool:
    return isinstance(getattr(node, "ctx", None), ast.Store)
