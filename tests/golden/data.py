"""The recorded files of the golden tests: how they are read and written."""

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "data"


def read(name: str) -> Any:
    """Read a recorded file."""
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def write(name: str, content: Any) -> None:
    """Write a recorded file. Only `python -m tests.golden.write` calls it."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    (FOLDER / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def plain(content: Any) -> Any:
    """Return content as it would be read back from a file."""
    return json.loads(json.dumps(content, allow_nan=False))
