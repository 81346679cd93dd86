"""The house checks: file lengths, layers, lint, format and types.

    python tests/checks/house.py [--root FOLDER] [CHECK...]

With no CHECK, all. Prints what fails and why; exit 1 where any does. `make check` and the tests
run this same script, the latter also on copies with a fault put in.
"""

import argparse
import os
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("schemas", "services", "cli", "tests", "benchmarks")
LONGEST = 500
REASON = f"Over {LONGEST} lines: "
"""The beginning of a paragraph, in a longer module's docstring, that says why it is one module."""


def length(root: Path) -> str:
    texts = {
        file.relative_to(root): file.read_text(encoding="utf-8")
        for package in PACKAGES
        for file in sorted((root / package).rglob("*.py"))
    }
    return "\n".join(
        f"{file.as_posix()}: {lines} lines: over {LONGEST}, say why in its docstring, or split it"
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


def run(root: Path, *command: str) -> str:
    """What the command printed, if it failed; the root's packages go before installed ones.

    import-linter breaks lines at 80 columns otherwise, and the names in them.
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
    check.__name__: check for check in (length, imports, lint, style, types)
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
