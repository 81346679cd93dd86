"""Imports of the product: pyproject.toml declares exactly these packages, and their licences allow our use."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib import metadata
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
PERMISSIVE = re.compile(r"Apache|BSD|MIT|ISC|PSF|Python Software Foundation|any-OSI")
FILE_BY_FILE = re.compile(r"MPL|Mozilla")
"""Licence that asks only those who change one of its files to publish it."""
READ = {
    "pymavlink": "LGPLv3",  # of an extra, imported unchanged, not in our wheel
    "docutils": "Public Domain",  # its GPL is of a mode for Emacs, which its wheel does not have
}
"""Packages of other licences that allow our use, with a word of each licence."""


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


def licence(package: metadata.Distribution) -> str:
    """Return the licences that a package declares: an expression, classifiers or free text."""
    told = package.metadata.json  # keys in lower case, and lists of what may be there several times
    classified = [each for each in told.get("classifier", []) if each.startswith("License ::")]
    return str(
        told.get("license_expression") or " ".join(classified) or told.get("license", "none")
    )


def installed_with_all_extras() -> dict[str, metadata.Distribution]:
    """Return all packages that a user of every extra gets here."""
    found: dict[str, metadata.Distribution] = {}
    waiting = [Requirement(f"quadctl[{','.join(PROJECT['optional-dependencies'])}]")]
    asked: set[tuple[str, str]] = set()
    while waiting:
        wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        package = found[name] = metadata.distribution(name)
        for extra in {"", *wanted.extras}:
            if (name, extra) not in asked:
                asked.add((name, extra))
                needed = map(Requirement, package.requires or [])
                waiting += [
                    n for n in needed if n.marker is None or n.marker.evaluate({"extra": extra})
                ]
    del found["quadctl"]
    return found


def allows_our_use(name: str, licence: str) -> bool:
    known = PERMISSIVE.search(licence) or FILE_BY_FILE.search(licence)
    copyleft = re.search(r"\bA?GPL|General Public", licence)
    return READ[name] in licence if name in READ else bool(known and not copyleft)


@pytest.mark.thorough
def test_the_licence_of_every_package_allows_our_use():
    licences = {name: licence(package) for name, package in installed_with_all_extras().items()}
    assert len(licences) > 50
    assert {name: told for name, told in licences.items() if not allows_our_use(name, told)} == {}
    assert set(READ) <= set(licences)


@pytest.mark.parametrize(
    "told", ["GPL-3.0-or-later", "AGPL-3.0", "GNU General Public License v2", "none"]
)
def test_a_licence_that_asks_more_is_found(told: str):
    assert not allows_our_use("other", told)
