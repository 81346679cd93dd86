"""Command that writes the automaton's table into docs/safety.md: `python -m docs.draw`."""

from pathlib import Path

from docs.diagram import diagram, table, words

PAGE = Path(__file__).with_name("safety.md")
_BEGIN, _END = "<!-- table -->\n", "<!-- /table -->"


def drawn(page: str) -> str:
    """Return the page with everything between its marks generated again."""
    head, _, rest = page.partition(_BEGIN)
    _, _, tail = rest.partition(_END)
    made = f"{diagram()}\n\n{words()}\n\n{table()}"
    return f"{head}{_BEGIN}{made}\n{_END}{tail}"


if __name__ == "__main__":
    PAGE.write_text(drawn(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
