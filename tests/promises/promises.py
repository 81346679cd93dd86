"""Promises of promises.txt, with the tests that hold them and the figures of long counts.

The file has sections (`## TITLE`), and in each of them entries in this form:

- `NUMBER. HAZARD`, and below it the promise, one sentence; a number is never given twice;
- `-`: the tests of one file, without `tests/` and `test_`; everyday tests come first;
- `=`: a figure of the long counts, by words that only the name of its proof contains. If an
  entry has several, each has its label and `<-` before it.

A line indented by four spaces continues the previous line.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_FILE = Path(__file__).with_name("promises.txt")


class Promise(NamedTuple):
    """Promise against one hazard; `tests` are node ids, `last` maps words of a proof to a label."""

    section: str
    number: int
    hazard: str
    promise: str
    tests: tuple[str, ...]
    last: dict[str, str]


def read(text: str) -> Iterator[Promise]:
    """Yield the promises of a text in the form of the file."""
    section = ""
    for entry in re.split(r"\n(?! )", text.strip()):
        if entry.startswith("## "):
            section = entry.removeprefix("## ")
        elif entry:
            yield _promise(section, entry)


def _promise(section: str, entry: str) -> Promise:
    head, *lines = re.sub(r"\n    ", " ", entry).splitlines()
    number, _, hazard = head.partition(". ")
    words = [line.strip() for line in lines]
    promise = " ".join(line for line in words if line[0] not in "-=")
    files = [line[2:].split(": ") for line in words if line[0] == "-"]
    tests = (
        f"tests/{'/test_'.join(file.rsplit('/', 1))}.py::test_{name}"
        for file, names in files
        for name in names.split()
    )
    figures = [line[2:].rpartition(" <- ") for line in words if line[0] == "="]
    last = {proof: label for label, _, proof in figures}
    return Promise(section, int(number), hazard, promise, tuple(tests), last)


PROMISES = tuple(read(_FILE.read_text(encoding="utf-8")))
