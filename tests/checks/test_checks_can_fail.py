"""House checks on a copy of the tree with all kinds of faults: each fault must be reported."""

import json
import shutil
import subprocess
import sys
from contextlib import suppress

import pytest

from tests.checks import house
from tests.support.once import once

# mypy reads the whole tree, at worst for the first time.
pytestmark = pytest.mark.thorough

IMPURE = ("time", "random", "os", "pathlib", "threading", "zenoh", "quadctl.services.runtime.node")
FORBIDDEN = {
    "quadctl.schemas": ("numpy", "typer", "quadctl.services.runtime", "quadctl.cli", *IMPURE),
    "cli": (
        "typer",
        "zenoh",
        "quadctl.services.dynamics",
        "quadctl.services.hub",
        "quadctl.services.pressure",
        "quadctl.services.safety",
    ),
    "quadctl.services.runtime": ("quadctl.services.safety", "quadctl.cli"),
    "quadctl.services.hub": ("quadctl.services.dynamics", "zenoh", "quadctl.cli"),
    "quadctl.services.dynamics": ("quadctl.services.safety", *IMPURE),
    "quadctl.services.pressure": ("quadctl.services.dynamics", *IMPURE),
    "quadctl.services.safety": ("quadctl.services.pressure", *IMPURE),
}
IMPORTS = [(importer, module) for importer, modules in FORBIDDEN.items() for module in modules]
LONG = "X = 0\n" * 501
UNDOCUMENTED = "def double(x: int) -> int:\n    return 2 * x\n"
UNFORMATTED = '"""A table."""\n\nX = {  }\n'
UNTYPED = '"""Twice."""\n\n\ndef double(x):\n    """Twice x."""\n    return 2 * x\n'
HEADLESS = '''"""What one sends."""

LIMIT = 1
"""Whether it\'s long."""


class Sender:
    """Who sends."""

    def send(self) -> int:
        """One that sends."""
        return LIMIT


class Message:
    """Message that one who sends it may lose."""
'''
WRONG = '"""Twice."""\n\nX: int = "two"\n'


def fault_name(module: str) -> str:
    return "fault_" + module.replace(".", "_")


def copy_tree(root):
    for name in (*house.PACKAGES, "docs", "src"):
        shutil.copytree(
            house.ROOT / name,
            root / name,
            symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    shutil.copy(house.ROOT / "pyproject.toml", root)
    # What mypy knows of the unchanged files: it compares their contents.
    with suppress(FileNotFoundError):
        shutil.copytree(house.ROOT / ".mypy_cache", root / ".mypy_cache")


def check_with_faults(root):
    """Write the output of each check on a copy of the tree with all faults."""
    copy_tree(root)
    for importer, module in IMPORTS:
        file = (
            root / importer.removeprefix("quadctl.").replace(".", "/") / f"{fault_name(module)}.py"
        )
        file.write_text(f"import {module}\n", encoding="utf-8")
    cli = root / "cli"
    (cli / "fault_501.py").write_text(LONG, encoding="utf-8")
    (cli / "no_fault_500.py").write_text(LONG.removesuffix("X = 0\n"), encoding="utf-8")
    (cli / "fault_undocumented.py").write_text(UNDOCUMENTED, encoding="utf-8")
    (cli / "fault_unformatted.py").write_text(UNFORMATTED, encoding="utf-8")
    (cli / "fault_untyped.py").write_text(UNTYPED, encoding="utf-8")
    (cli / "fault_wrong.py").write_text(WRONG, encoding="utf-8")
    (cli / "fault_headless.py").write_text(HEADLESS, encoding="utf-8")
    found = {name: check(root) for name, check in house.CHECKS.items()}
    (root / "seen.json").write_text(json.dumps(found), encoding="utf-8")


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """Return the output of each check."""
    root = once(tmp_path_factory, "tree", check_with_faults)
    return json.loads((root / "seen.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("importer", "module"), IMPORTS)
def test_a_forbidden_import_is_reported(seen, importer, module):
    assert f"{importer}.{fault_name(module)} -> {module} (l.1)" in seen["imports"]


@pytest.mark.parametrize(
    ("check", "named"),
    [
        ("length", "cli/fault_501.py: 501 lines"),
        ("lint", "cli/fault_undocumented.py:1:5: D103"),
        ("lint", "cli/fault_zenoh.py:1:8: F401"),
        ("style", "cli/fault_unformatted.py"),
        ("clauses", "cli/fault_headless.py:1: begins with a headless clause: What one sends."),
        ("clauses", "cli/fault_headless.py:4: begins"),
        ("clauses", "cli/fault_headless.py:8: begins"),
        ("clauses", "cli/fault_headless.py:11: begins"),
        ("types", "cli/fault_untyped.py:4: error: Function is missing a type annotation"),
        ("types", "cli/fault_wrong.py:3: error: Incompatible types in assignment"),
    ],
)
def test_a_fault_is_reported(seen, check, named):
    assert named in seen[check]


def test_the_type_check_reports_only_the_faults(seen):
    found = [line for line in seen["types"].splitlines() if "/fault_" not in line.partition(":")[0]]
    assert found == []


def test_a_clause_after_its_noun_is_allowed(seen):
    assert seen["clauses"].count("fault_headless.py") == 4


def test_500_lines_are_allowed(seen):
    assert "no_fault_500" not in seen["length"]


@pytest.mark.parametrize(
    ("lines", "status", "said"), [(500, 0, "length: ok"), (501, 1, "length: FAIL")]
)
def test_the_command_exits_with_the_fault(tmp_path, lines, status, said):
    for package in house.PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "short.py").write_text("X = 0\n", encoding="utf-8")
    (tmp_path / "cli" / "long.py").write_text("X = 0\n" * lines, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, house.__file__, "--root", tmp_path, "length"],
        stdout=subprocess.PIPE,
        encoding="utf-8",
        check=False,
    )
    assert (done.returncode, done.stdout.splitlines()[0]) == (status, said)
