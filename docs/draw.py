"""Command that writes the generated tables of docs/, and a picture: `python -m docs.draw`."""

from collections.abc import Callable
from pathlib import Path

from benchmarks.tables import between
from docs import declared
from docs.diagram import diagram, limits, table, words
from tests.promises.table import table as promises

_DOCS = Path(__file__).parent
PROMISES = _DOCS / "promises.md"
PAGES: dict[Path, Callable[[], str]] = {
    _DOCS / "explanation" / "safety.md": lambda: f"{words()}\n\n{table()}\n\n{limits()}\n",
    _DOCS / "how-to" / "faults-and-wind.md": declared.faults,
    _DOCS / "how-to" / "grading.md": declared.graded,
    _DOCS / "reference" / "commands.md": declared.commands,
    _DOCS / "reference" / "exit-codes.md": declared.exit_codes,
    _DOCS / "reference" / "files.md": declared.files,
    _DOCS / "reference" / "keys-and-types.md": declared.keys,
    _DOCS / "reference" / "parameters.md": declared.parameters,
    _DOCS / "reference" / "types.md": declared.types,
    PROMISES: promises,
}
"""Text between the marks of each page."""
PICTURES: dict[Path, Callable[[], str]] = {_DOCS / "explanation" / "automaton.svg": diagram}
"""Text of each picture."""


def drawn(page: Path) -> str:
    """Return the page with everything between its marks generated again."""
    return between(page.read_text(encoding="utf-8"), "table", PAGES[page]())


def write(page: Path) -> None:
    """Write the page with everything between its marks generated again."""
    page.write_text(drawn(page), encoding="utf-8")


if __name__ == "__main__":
    for each in PAGES:
        write(each)
    for picture, text in PICTURES.items():
        picture.write_text(text(), encoding="utf-8")
