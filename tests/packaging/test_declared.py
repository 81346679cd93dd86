"""Imports of the product: pyproject.toml declares exactly these packages."""

import ast
import sys
import tomllib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FOLDERS = ("cli", "services", "schemas")
OF = {"yaml": "pyyaml", "zenoh": "eclipse-zenoh"}
"""Distributions by the different name of their module."""
BELOW = {
    "fastapi": "nicegui",
    "uvicorn": "nicegui",
    "llvmlite": "numba",
    "lz4": "mcap",
    "zstandard": "mcap",
}
"""Declared packages by the name of a dependency that is imported too."""


def imported() -> Iterator[str]:
    for package in FOLDERS:
        for file in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_bytes())):
                if isinstance(node, ast.Import):
                    yield from (alias.name for alias in node.names)
                elif isinstance(node, ast.ImportFrom):
                    yield node.module or ""


@pytest.mark.thorough
def test_declared_packages_are_exactly_the_imported_ones():
    modules = {name.partition(".")[0] for name in imported()}
    foreign = modules - {"quadctl"} - sys.stdlib_module_names
    extras = PROJECT["optional-dependencies"].values()
    asked = [*PROJECT["dependencies"], *chain.from_iterable(extras)]
    declared = {canonicalize_name(Requirement(each).name) for each in asked}
    assert {BELOW.get(name) or OF.get(name) or name for name in foreign} == declared
