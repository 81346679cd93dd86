"""Copies of the package with changed declarations, as another version would have them."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
Edits = Mapping[str, Sequence[tuple[str, str]]]
"""Texts to replace, each once, by the name of a file of `schemas/`."""

NEWER: Edits = {
    "messages.py": [
        ("    body_rates: BodyRates\n", "    body_rates: BodyRates\n    gust: Spread = 0.5\n"),
        ("    near: bool = False\n", "    near: bool = False\n    side: Text = 'north'\n"),
        (
            "    nearest: NearestWall = NearestWall()\n",
            "    nearest: NearestWall = NearestWall()\n    battery: Count = 7\n",
        ),
    ],
    "services.py": [
        (
            "class GotoRequest(Struct, frozen=True, forbid_unknown_fields=True):",
            "class GotoRequest(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):",
        ),
        ("    wait: bool = False\n", "    wait: bool = False\n    gently: bool = False\n"),
        ("    accepted: bool\n    reason: Text\n",
         "    accepted: bool\n    reason: Text\n    expected: Seconds = 2.5\n"),
        ("    in_force: dict[str, Any] = {}\n",
         "    in_force: dict[str, Any] = {}\n    revision: int = 0\n"),
    ],
    "params.py": [
        ("    acceptance_range: ", "    novelty: float = 1.0\n    acceptance_range: "),
    ],
}  # fmt: skip
"""Fields with a default: in messages, in a part of one, in a request, replies, and a parameter."""
OTHER: Edits = {
    "messages.py": [("    stamp: Seconds\n    position: Position\n",
                     "    stamp: float\n    position: Position\n")],
    "services.py": [
        (
            "class GotoRequest(Struct, frozen=True, forbid_unknown_fields=True):",
            "class GotoRequest(Struct, forbid_unknown_fields=True, rename={'replace': 'instead'}):",
        ),
        ("class HoldResponse(Struct, frozen=True):",
         "class HoldResponse(Struct, frozen=True, rename={'success': 'done'}):"),
    ],
}  # fmt: skip
"""A field of another type, and renamed ones, in a message, a request and a reply."""


def changed_copy(folder: Path, edits: Edits) -> Path:
    """Make a changed copy of the package, with its digests; return the path for PYTHONPATH."""
    package = folder / "quadctl"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "src" / "quadctl", package, ignore=ignored)
    for name, replacements in edits.items():
        file = package / "schemas" / name
        text = file.read_text(encoding="utf-8")
        for old, new in replacements:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        file.write_text(text, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    writing = "from tests.golden import digests; digests.write()"
    subprocess.run([sys.executable, "-P", "-c", writing], env=environment, check=True)
    return folder
