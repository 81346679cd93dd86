"""Commands run in this process: their output and exit code."""

import os
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import pytest

from quadctl.cli import command
from quadctl.cli.commands import COMMANDS


class Result(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Return the only document on stdout."""
        return msgspec.json.decode(self.out)

    @property
    def error(self) -> dict[str, str]:
        """Return the only error document on stderr."""
        document = msgspec.json.decode(self.err, type=dict[str, dict[str, str]])
        assert list(document) == ["error"]
        return document["error"]


Quadctl = Callable[..., Result]


def command_of(words: str) -> str:
    """Return the path of the command that a line begins with."""
    found = [path for path in COMMANDS if f"{words} ".startswith(f"{path} ")]
    return max(found, key=len, default="")


class _Left(BaseException):
    """Raised instead of ending the process."""


def runner(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Quadctl:
    def leave(code: int) -> None:
        raise _Left(code)

    monkeypatch.setattr(command, "_leave", leave)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*words: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["quadctl", *map(str, words)])
        try:
            command.main()
        except _Left as left:
            code = int(left.args[0])
        else:
            raise AssertionError(f"quadctl {words} did not leave, in {os.getpid()}")
        return Result(code, *capsys.readouterr())

    return run
