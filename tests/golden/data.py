"""Reading and writing the recorded files of the golden tests."""

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "data"
HOW = "if this is intended: `make accept` shows all that follows, `make accept WRITE=1` writes it"
"""Remark of each test that finds something stale."""


def read(name: str) -> Any:
    """Read a recorded file."""
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def write(name: str, content: Any) -> None:
    """Write a recorded file; called only by `make accept` and `python -m tests.golden.write`."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    (FOLDER / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def plain(content: Any) -> Any:
    """Return `content` as JSON reads it back from a file."""
    return json.loads(json.dumps(content, allow_nan=False))
