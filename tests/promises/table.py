"""Table of docs/promises.md, made from the promises and from the results of the long counts."""

import ast
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from tests.promises.promises import PROMISES, Promise

ROOT = Path(__file__).parents[2]
FILE = ROOT / "benchmarks" / "proofs.json"

Proof = dict[str, Any]
"""A result of a long count: `promise`, `found`, `promised`; `commit`, `date`, `processor` of the run."""


def proofs() -> list[Proof]:
    """Return the results so far."""
    found: list[Proof] = msgspec.json.decode(FILE.read_bytes()) if FILE.exists() else []
    return found


def table() -> str:
    """Return the table, and below it the processors of the runs."""
    found = proofs()
    rows = ["| against | promise | held by | last found |", "|---|---|---|---|"]
    rows += [
        f"| {each.hazard} | {each.promise} | {'<br>'.join(map(_link, each.tests))}"
        f" | {_figures(each, found)} |"
        for each in PROMISES
    ]
    processors = sorted({proof["processor"] for proof in found})
    words = (
        "The name of a test is `test_` and its words joined by `_`. The long counts ran on"
        f" {', '.join(processors)}."
    )
    return "\n".join([*rows, "", words]) + "\n"


def owners(proof: Proof) -> list[Promise]:
    """Return the promises that show the result of this proof."""
    return [each for each in PROMISES if any(words in proof["promise"] for words in each.last)]


def tier(test: str) -> str:
    """Return `thorough` or `prove` for a test (a node id), and an empty text if `make test` runs it.

    Raises LookupError if there is no such test.
    """
    path, _, name = test.partition("::")
    found = _tests(path)
    if name not in found:
        raise LookupError(f"there is no {test}")
    return found[name]


@cache
def _tests(path: str) -> dict[str, str]:
    """Return the tests of a file, each with its tier; empty if there is no file."""
    file = ROOT / path
    if not file.is_file():
        return {}
    tree = ast.parse(file.read_text(encoding="utf-8"))
    marks = [
        mark
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark"
        for mark in (node.value.elts if isinstance(node.value, ast.List) else [node.value])
    ]
    found = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            # The mark of a single parameter leaves the test in `make test`.
            own = {ast.unparse(mark) for mark in [*marks, *node.decorator_list]}
            tiers = (tier for tier in ("prove", "thorough") if f"pytest.mark.{tier}" in own)
            found[node.name] = next(tiers, "")
    return found


def _link(test: str) -> str:
    path, _, name = test.partition("::")
    words = f"[{name.removeprefix('test_').replace('_', ' ')}](../{path})"
    return f"**{words}**" if tier(test) == "prove" else words


def _figures(promise: Promise, found: list[Proof]) -> str:
    shown = [
        f"{of and f'{of}: '}{proof['found']}; promised: {proof['promised']} ({proof['commit']})"
        for words, of in promise.last.items()
        for proof in found
        if words in proof["promise"]
    ]
    return "<br>".join(shown) or ("not run yet" if promise.last else "")
