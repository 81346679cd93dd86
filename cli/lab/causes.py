"""Cause of a node's end, found in the lines that it has logged. Pure."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePath

from quadctl.cli.lab.machine import KILLED

_COPY = re.compile(r"(?:|/.*/quadctl-lab-[^/]+/root/\d+)/handin/(.+)")
"""File of a hand-in as its own nodes see it: in namespaces, or in the grader's temporary folder."""
_FRAME = re.compile(r'\s+File "(.+)", line (\d+)')
_ERROR = re.compile(r"[A-Za-z_][\w.]*(:|$)")


def last_cause(lines: Iterable[str], folder: Path) -> str:
    """Return the limit that has ended a node, or the error of the last traceback with its place in the hand-in.

    It is empty without either.
    """
    found, places = "", list[tuple[str, str]]()
    for line in lines:
        if line.startswith(KILLED):
            found = line
        elif frame := _FRAME.match(line):
            places.append((frame[1], frame[2]))
        elif places and line[:1].strip():
            # Lines of the source are indented.
            if _ERROR.match(line):
                found = f"{line} ({_place(places, folder)})"
            places = []
    return found


def _place(places: Sequence[tuple[str, str]], folder: Path) -> str:
    """Return the innermost place in a file of the student, else the innermost one."""
    for file, line in reversed(places):
        if copied := _COPY.fullmatch(file):
            return f"{copied[1]}, line {line}"
        for parent in (folder, folder.resolve()):
            if PurePath(file).is_relative_to(parent):
                return f"{PurePath(file).relative_to(parent).as_posix()}, line {line}"
    file, line = places[-1]
    return f"{PurePath(file).name}, line {line}"
