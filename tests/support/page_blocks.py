"""Fenced blocks of the Markdown pages, the commands in them, and a comparison with real output."""

import re
from pathlib import Path
from typing import NamedTuple

FENCE = re.compile(r"^```([^\s`]*)[ \t]*([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TITLE = re.compile(r'^title="([^"]+)"$')
NUMBER = re.compile(r"(?<![\w.])-?(?:\d+\.\d+(?:e[-+]?\d+)?|\d+e[-+]?\d+|\d{3,})(?![\w.]*\w)")
"""A number that may vary: with a decimal point, an exponent, or at least three digits."""
PAUSE = re.compile(r"^(?:paused: .*|went on)\n", re.MULTILINE)
"""What `goto` prints besides when the machine stalls and the flight pauses."""
ANY_NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


class Block(NamedTuple):
    """A fenced block; `info` is the rest of its first line, behind the language."""

    language: str
    info: str
    text: str

    @property
    def title(self) -> str:
        """The file that the block is the content of; empty for none."""
        found = TITLE.match(self.info)
        return found[1] if found else ""


class Command(NamedTuple):
    """A line that begins with `$ `, and the output shown below it."""

    line: str
    output: str

    @property
    def bare(self) -> str:
        """The line without its comment."""
        return re.sub(r"\s+# .*", "", self.line)


def blocks(page: Path) -> list[Block]:
    return [Block(*found) for found in FENCE.findall(page.read_text(encoding="utf-8"))]


def commands(block: Block) -> list[Command]:
    assert block.text.startswith("$ "), f"a console block begins with `$ `:\n{block.text}"
    parts = re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]
    return [
        Command(line, output.rstrip()) for line, _, output in (p.partition("\n") for p in parts)
    ]


def fits(shown: str, printed: str) -> bool:
    """Return whether an output is as shown.

    A line `...` stands for any lines or none, `...` in a line for anything, a NUMBER for any other
    number, and blanks for any count of blanks. A PAUSE does not count.
    """
    pattern = "".join(map(_pattern, shown.splitlines()))
    text = f"{printed.rstrip()}\n" if printed.strip() else ""
    return re.fullmatch(pattern, PAUSE.sub("", text)) is not None


def _pattern(line: str) -> str:
    if line == "...":
        return "(?:.*\n)*"
    # The last three of four points: one before them ends the word.
    dots = re.compile(r"(?:\\\.){3}(?!\\\.)")
    fixed = (dots.sub(".*", re.escape(part)) for part in NUMBER.split(line.rstrip()))
    return re.sub(r"(?:\\ )+", " +", ANY_NUMBER.join(fixed)) + "\n"
