"""Every command in a folder that was deleted meanwhile: one line, and no traceback."""

import os
import shlex
from pathlib import Path

import pytest

from quadctl.cli.commands import COMMANDS, command
from tests.support.command_line import Quadctl

NEED_ONE = {"demo", "hub", "init", "up"}
"""Commands whose example cannot do without a folder: they write into it, or run its processes."""


def example(path: str) -> list[str]:
    """Return the words of a command's example."""
    text = (command(path).__doc__ or "").partition("Example: quadctl ")[2].strip()
    assert text, path
    return shlex.split(text)


def become(*_: object) -> None:
    """End the command where it would become a bridge."""
    raise SystemExit(0)


@pytest.mark.parametrize("path", sorted({*COMMANDS} - {"campaign"}))
def test_it_fails_in_one_line_or_needs_no_folder(
    path: str, quadctl: Quadctl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    gone = tmp_path / "gone"
    gone.mkdir()
    os.chdir(gone)
    gone.rmdir()
    monkeypatch.setattr(os, "execv", become)
    result = quadctl(*example(path))
    assert "Traceback" not in result.err
    assert result.code in {0, 1, 2, 3, 6, 8}
    if path in NEED_ONE:
        assert result.code in {1, 6}
        assert "deleted" in result.err
