"""The README's table, made from the figures."""

from pathlib import Path
from typing import Any

_README = Path(__file__).parents[1] / "README.md"
_BEGIN, _END = "<!-- figures -->", "<!-- /figures -->"


def write(document: dict[str, Any]) -> None:
    """Put the table between its two marks."""
    text = _README.read_text(encoding="utf-8")
    head, rest = text.split(_BEGIN)
    _, tail = rest.split(_END)
    _README.write_text(f"{head}{_BEGIN}\n{table(document)}{_END}{tail}", encoding="utf-8")


def table(document: dict[str, Any]) -> str:
    """The figures as a table, and what they were measured on."""
    rows = ["| what | median | p99 | bar | |", "|---|---|---|---|---|"]
    for figure in document["figures"]:
        unit = f" {figure['unit']}".rstrip()
        verdict = "holds" if figure["holds"] else "**missed**"
        rows.append(
            f"| {figure['name']} | {figure['median']:.3g}{unit} | {figure['p99']:.3g}{unit}"
            f" | {figure['bar']:g}{unit} | {verdict} |"
        )
    machine = document["machine"]
    rows.append("")
    rows.append(
        f"Measured by `make prove` on {machine['processor']}, Python {machine['python']},"
        f" {machine['date']}, commit {machine['commit']}."
    )
    return "\n".join(rows) + "\n"
