"""Modules of the product: no import cycles, and one meaning per name."""

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("schemas", "services", "cli")
FILES = {
    "quadctl."
    + ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): file
    for folder in FOLDERS
    for file in sorted((ROOT / folder).rglob("*.py"))
}
RUNTIME = "quadctl.services.runtime"
TWICE: set[str] = set()
"""Names that two public classes may share, each with its reason."""


def imported(module: str) -> Iterator[str]:
    """Yield our modules that a module imports: at its top, in functions, and only for types."""
    for node in ast.walk(ast.parse(FILES[module].read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in FILES else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def cycle(graph: Mapping[str, Iterable[str]]) -> list[str]:
    try:
        TopologicalSorter({k: set(v) - {k} for k, v in graph.items()}).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.fixture(scope="module")
def imports() -> dict[str, list[str]]:
    """Return our modules that each of our modules imports."""
    return {module: [name for name in imported(module) if name in FILES] for module in FILES}


@pytest.mark.thorough
def test_no_import_cycle_with_lazy_and_typing_imports(imports: dict[str, list[str]]):
    assert len(imports) > 150
    assert cycle(imports) == []


def test_no_cycle_between_the_folders_of_the_runtime(imports: dict[str, list[str]]):
    def part(module: str) -> str:
        # A folder is one part; each module at the root is one part too.
        return module.removeprefix(f"{RUNTIME}.").partition(".")[0]

    graph: defaultdict[str, set[str]] = defaultdict(set)
    for module, names in imports.items():
        if module.startswith(f"{RUNTIME}."):
            graph[part(module)] |= {part(n) for n in names if n.startswith(f"{RUNTIME}.")}
    assert {"bus", "params", "recording", "security", "supervisor"} <= set(graph)
    assert cycle(graph) == []


def test_a_cycle_is_found():
    assert cycle({"a": ["b"], "b": ["c"], "c": ["a"]})


@pytest.mark.thorough
def test_no_module_imports_the_facade():
    assert [module for module in FILES if "quadctl" in imported(module)] == []


@pytest.mark.thorough
def test_two_public_classes_never_share_a_name():
    homes = defaultdict(list)
    for module, file in FILES.items():
        for node in ast.parse(file.read_bytes()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(module)
    assert {
        name: where for name, where in homes.items() if len(where) > 1 and name not in TWICE
    } == {}


def test_module_names_are_unique_in_the_runtime():
    homes = defaultdict(list)
    for module, file in FILES.items():
        if module.startswith(RUNTIME) and file.name != "__init__.py":
            homes[file.name].append(module)
    assert {name: where for name, where in homes.items() if len(where) > 1} == {}
