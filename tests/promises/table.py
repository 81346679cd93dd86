"""Tables of docs/promises.md, made from the promises and from the results of the long counts."""

import ast
from functools import cache
from itertools import groupby
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
    """Return the promises, a table for each section, and below them what the long counts found."""
    lines: list[str] = []
    for section, promises in groupby(PROMISES, lambda each: each.section):
        lines += [f"## {section}", "", "| no. | against | promise |", "|---|---|---|"]
        lines += [f"| {each.number} | {each.hazard} | {each.promise} |" for each in promises]
        lines.append("")
    return "\n".join([*lines, *_counts(proofs())]) + "\n"


def _counts(found: list[Proof]) -> list[str]:
    rows = [
        f"| {each.number} | {cells} |"
        for each in sorted(PROMISES, key=lambda each: each.number)
        for cells in _figures(each, found)
    ]
    processors = sorted({proof["processor"] for proof in found})
    return [
        "## What the long counts found",
        "",
        f"The last runs, on {', '.join(processors)}; each names its commit.",
        "",
        "<details markdown>",
        f"<summary>{len(rows)} results</summary>",
        "",
        "| no. | counted | found | promised | commit |",
        "|---|---|---|---|---|",
        *rows,
        "",
        "</details>",
    ]


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


def _figures(promise: Promise, found: list[Proof]) -> list[str]:
    """Return the cells of each result: what was counted, found and promised, and the commit."""
    return [
        f"{label or promise.hazard} | {proof['found']} | {proof['promised']} | {proof['commit']}"
        for words, label in promise.last.items()
        for proof in found
        if words in proof["promise"]
    ] or [f"{promise.hazard} | not run yet | | "] * bool(promise.last)
