"""Functions of the model as one flat syntax tree, and a cache of generated modules.

The model is straight-line code in several modules. The requested functions and all that they call
are merged into one tree for a backend, without annotations and docstrings, constants by value.
"""

import ast
import hashlib
import importlib.util
import inspect
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType

from quadctl.services.dynamics import controller, flight_modes, rigidbody, rotor, trajectory, wind
from quadctl.services.dynamics.compiled import branchless
from quadctl.services.runtime.realm import spare_folder, write_atomically


def load_module(name: str, source: str) -> ModuleType:
    """Import this source from a file with its digest in its name; the compiler caches beside it."""
    digest = hashlib.sha256(source.encode()).hexdigest()[:12]
    path = cache_folder() / f"{name}_{digest}.py"
    if not path.exists():
        write_atomically(path, source.encode())
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # the compiler looks it up here
    spec.loader.exec_module(module)
    return module


def cache_folder() -> Path:
    """Return the folder of the generated modules, and create it: in the user's cache, if there is one."""
    home = os.environ.get("XDG_CACHE_HOME")
    # Without a home pathlib raises RuntimeError.
    with suppress(OSError, RuntimeError):
        folder = (Path(home) if home else Path.home() / ".cache") / "quadctl"
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    return spare_folder("cache")


MODULES = (rigidbody, rotor, controller, trajectory, branchless, wind, flight_modes)
"""The model's modules, each after those that it imports."""

BUILTINS = {"abs", "range", "sqrt"}
"""Functions that the model calls and a backend provides."""


def merged(roots: Iterable[str]) -> list[ast.FunctionDef]:
    """Return the functions with these names and all that they call, callees first.

    `flight_modes__move` is `flight_modes.move`. Raises NameError for a name outside the model.
    """
    found: dict[str, ast.FunctionDef] = {}
    sources = {_short(module): _Source(module) for module in MODULES}

    def take(name: str) -> None:
        if name in found:
            return
        module, _, own = name.partition("__")
        function, calls = sources[module].flat(own)
        for called in calls:
            take(called)
        found[name] = function

    for root in roots:
        take(root)
    return list(found.values())


class _Source:
    """One module's functions, and the flat names of its names."""

    def __init__(self, module: ModuleType) -> None:
        self._module = module
        tree = ast.parse(inspect.getsource(module))
        self._functions = {
            node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)
        }
        short = _short(module)
        self._names = {name: f"{short}__{name}" for name in self._functions}
        self._modules: dict[str, str] = {}
        for name, origin, own in _imported(tree):
            if own is None:
                self._modules[name] = origin
            else:
                self._names[name] = f"{origin}__{own}"

    def flat(self, name: str) -> tuple[ast.FunctionDef, list[str]]:
        """Return a function with flat names, and the functions that it calls."""
        flat = _Flat(self._module, self._names, self._modules)
        return flat.function(self._functions[name]), flat.calls


class _Flat(ast.NodeTransformer):
    """Renamer of the module's and other modules' names in a function."""

    def __init__(self, module: ModuleType, names: dict[str, str], modules: dict[str, str]) -> None:
        self._module, self._names, self._modules = module, names, modules
        self._locals: set[str] = set()
        self.calls: list[str] = []

    def function(self, node: ast.FunctionDef) -> ast.FunctionDef:
        """Return a function of the module, under its flat name."""
        arguments = [argument.arg for argument in node.args.args]
        names = [n for n in ast.walk(node) if isinstance(n, ast.Name)]
        self._locals = {*arguments, *(n.id for n in names if isinstance(n.ctx, ast.Store))}
        made = ast.parse(f"def {self._names[node.name]}({', '.join(arguments)}): pass").body[0]
        assert isinstance(made, ast.FunctionDef)  # noqa: S101 - the source is one
        made.body = [self.visit(statement) for statement in node.body[1:]]  # after its docstring
        return made

    def visit_Name(self, node: ast.Name) -> ast.AST:
        name = node.id
        if name in self._locals or name in BUILTINS:
            return node
        if name in self._names and callable(getattr(self._module, name)):
            return self._called(self._names[name])
        value = getattr(self._module, name)
        if not isinstance(value, (int, float)):
            raise TypeError(
                f"the model's source uses {value!r}, which is neither part of it nor a number"
            )
        return ast.Constant(value)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if not isinstance(node.value, ast.Name):
            raise TypeError(f"{ast.unparse(node)} is not a function of another module")
        return self._called(f"{self._modules[node.value.id]}__{node.attr}")

    def _called(self, name: str) -> ast.AST:
        self.calls.append(name)
        return ast.Name(name, ast.Load())


def _imported(tree: ast.Module) -> Iterator[tuple[str, str, str | None]]:
    """Yield names that a module imports from the model: its own name, module, name there."""
    package = flight_modes.__name__.rpartition(".")[0]
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(package):
            origin = (node.module or "").removeprefix(package).lstrip(".")
            for alias in node.names:
                name = alias.asname or alias.name
                yield (name, origin, alias.name) if origin else (name, alias.name, None)


def _short(module: ModuleType) -> str:
    return module.__name__.rpartition(".")[2]
