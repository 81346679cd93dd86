"""The README's table, made from the file of figures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.bars import Figure, Side, judge
from benchmarks.document import figures
from benchmarks.report import limits, number, ratio
from benchmarks.rows import Row

_README = Path(__file__).parents[1] / "README.md"


def write(document: Mapping[str, Any]) -> None:
    """Put the table between its two marks."""
    replace("figures", table(document))


def replace(name: str, table: str) -> None:
    """Put a table between the marks of that name."""
    text = _README.read_text(encoding="utf-8")
    _README.write_text(between(text, name, table), encoding="utf-8")


def between(text: str, name: str, table: str) -> str:
    """The text with what stands between the marks replaced."""
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    head, rest = text.split(begin)
    _, tail = rest.split(end)
    return f"{head}{begin}\n{table}{end}{tail}"


def table(document: Mapping[str, Any]) -> str:
    """The figures as a table, and what they were measured on."""
    rows = [
        "| median (p99) | quadctl | raw Zenoh | ROS 1 | bar | |",
        "|---|---|---|---|---|---|",
        *(_row(row, figure) for row, figure in figures(document)),
    ]
    machine = document["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in machine["packages"].items())
    measured = (
        f"Measured by `make prove` on {machine['processor']}, Python {machine['python']},"
        f" {packages}, {machine['date']}, commit {machine['commit']}."
        " A peer's cell has its median and ours divided by it; [benchmarks](benchmarks/README.md)"
        " says how each is measured."
    )
    rows += ["", measured]
    return "\n".join(rows) + "\n"


def _row(row: Row, figure: Figure) -> str:
    verdict = judge(figure, row.bars) if row.bars else ""
    shown = f"**{verdict}**" if verdict in {"missed", "failed"} else verdict
    cells = [row.name, _ours(row, figure), _peer(row, figure, "raw"), _peer(row, figure, "ros")]
    return f"| {' | '.join([*cells, limits(row), shown])} |"


def _ours(row: Row, figure: Figure) -> str:
    if "ours" not in figure.sides:
        return "-"
    ours = figure.sides["ours"]
    spread = f" ({number(ours.tail)})" if ours.n > 1 else ""
    return f"{number(ours.median)} {row.unit}".rstrip() + spread


def _peer(row: Row, figure: Figure, side: Side) -> str:
    if side in figure.missing:
        return figure.missing[side]
    if side not in figure.sides:
        return ""
    return f"{number(figure.sides[side].median)} {row.unit} (x {ratio(figure, side)})"
