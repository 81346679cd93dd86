"""House checks: file lengths, layers, lint, format, types and headless clauses.

    python tests/checks/house.py [--root FOLDER] [CHECK...]

Without CHECK it runs all. It prints each failure with its reason, and exits with 1 if there is one.
`make check` and the tests run this script, the tests also on copies with faults.
"""

import argparse
import ast
import os
import re
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("schemas", "services", "cli", "tests", "benchmarks", "deploy")
DOCUMENTED = ("schemas", "services", "cli", "src/quadctl", "benchmarks", "deploy", "docs")
"""Folders of modules whose docstrings are checked for headless clauses."""
HEADLESS = re.compile(
    r"\W*(who|whose|whom|what|whether|that of|those of|one that|one who)\b", re.IGNORECASE
)
"""Start of a docstring that has a clause in the place of a noun or a verb."""
LONGEST = 500
REASON = f"Over {LONGEST} lines: "
"""Start of the docstring paragraph that gives the reason for a longer module."""


def length(root: Path) -> str:
    texts = {
        file.relative_to(root): file.read_text(encoding="utf-8")
        for package in PACKAGES
        for file in sorted((root / package).rglob("*.py"))
    }
    return "\n".join(
        f"{file.as_posix()}: {lines} lines: over {LONGEST}: give the reason in its docstring, or split it"
        for file, text in texts.items()
        if (lines := len(text.splitlines())) > LONGEST and f"\n{REASON}" not in text
    )


def imports(root: Path) -> str:
    return run(root, str(Path(sysconfig.get_path("scripts")) / "lint-imports"), "--no-cache")


def lint(root: Path) -> str:
    return run(
        root, sys.executable, "-m", "ruff", "check", "--quiet", "--output-format=concise", "."
    )


def style(root: Path) -> str:
    return run(root, sys.executable, "-m", "ruff", "format", "--check", "--quiet", ".")


def types(root: Path) -> str:
    return run(root, sys.executable, "-m", "mypy", "--no-error-summary")


def clauses(root: Path) -> str:
    return "\n".join(
        f"{file.relative_to(root).as_posix()}:{line}: begins with a headless clause: {text}"
        for folder in DOCUMENTED
        for file in sorted((root / folder).rglob("*.py"))
        for line, text in docstrings(file)
        if HEADLESS.match(text)
    )


def docstrings(file: Path) -> list[tuple[int, str]]:
    """Return line and text of every docstring, including attributes."""
    return [
        (node.lineno, " ".join(node.value.value.split()))
        for node in ast.walk(ast.parse(file.read_bytes()))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    ]


def run(root: Path, *command: str) -> str:
    """Return the output of a command if it failed; the root's packages precede installed ones.

    COLUMNS is wide because import-linter breaks lines, and the names in them, at 80 columns.
    """
    done = subprocess.run(
        command,
        cwd=root,
        env=os.environ | {"PYTHONPATH": f"{root / 'src'}:{root}", "COLUMNS": "200"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        check=False,
    )
    return (done.stdout or f"exit {done.returncode}") if done.returncode else ""


CHECKS: dict[str, Callable[[Path], str]] = {
    check.__name__: check for check in (length, imports, lint, style, types, clauses)
}


def main() -> int:
    parser = argparse.ArgumentParser(description="The house checks.")
    parser.add_argument("--root", type=Path, default=ROOT)
    parser.add_argument("checks", nargs="*", metavar="CHECK", help=", ".join(CHECKS))
    asked = parser.parse_args()
    if unknown := set(asked.checks) - set(CHECKS):
        parser.error(f"no such check: {', '.join(sorted(unknown))}; there are {', '.join(CHECKS)}")
    failed = False
    for name in asked.checks or CHECKS:
        found = CHECKS[name](asked.root.resolve())
        failed |= bool(found)
        print(f"{name}: FAIL\n{found}" if found else f"{name}: ok", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
