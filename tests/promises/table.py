"""The README's table of promises, made from what is written here and from what was found."""

import ast
from functools import cache
from pathlib import Path
from typing import Any

from tests.promises.promises import PROMISES, Promise

ROOT = Path(__file__).parents[2]

Proof = dict[str, Any]
"""`promise`, what was `found`, what is `promised`; `commit`, `date` and `processor` of the run."""


def table(proofs: list[Proof]) -> str:
    """The table, and what its figures were found on."""
    rows = ["| against | promise | held by | last found |", "|---|---|---|---|"]
    rows += [
        f"| {each.hazard} | {each.promise} | {'<br>'.join(map(_link, each.tests))}"
        f" | {_figures(each, proofs)} |"
        for each in PROMISES
    ]
    processors = sorted({proof["processor"] for proof in proofs})
    words = (
        "A test's name is its words joined by `_`, with `test_` before them. Bold ones are the long"
        f" counts, run by `make prove`; found on {', '.join(processors)}."
    )
    return "\n".join([*rows, "", words]) + "\n"


def owners(proof: Proof) -> list[Promise]:
    """The promises that a proof gives a figure of."""
    return [each for each in PROMISES if any(words in proof["promise"] for words in each.last)]


def is_long(test: str) -> bool:
    """Whether a test, by its node id, is left to `make prove`; raises LookupError for none."""
    path, _, name = test.partition("::")
    found = _tests(path)
    if name not in found:
        raise LookupError(f"there is no {test}")
    return found[name]


@cache
def _tests(path: str) -> dict[str, bool]:
    """The tests of a file, and whether each is a long one; none of a file that there is not."""
    file = ROOT / path
    if not file.is_file():
        return {}
    tree = ast.parse(file.read_text(encoding="utf-8"))
    marks = [
        ast.unparse(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark"
    ]
    return {
        node.name: any(
            "mark.prove" in each for each in [*marks, *map(ast.unparse, node.decorator_list)]
        )
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


def _link(test: str) -> str:
    path, _, name = test.partition("::")
    words = f"[{name.removeprefix('test_').replace('_', ' ')}]({path})"
    return f"**{words}**" if is_long(test) else words


def _figures(promise: Promise, proofs: list[Proof]) -> str:
    told = [
        f"{of and f'{of}: '}{proof['found']}; promised: {proof['promised']} ({proof['commit']})"
        for words, of in promise.last.items()
        for proof in proofs
        if words in proof["promise"]
    ]
    return "<br>".join(told) or ("not run yet" if promise.last else "")
