"""Tables that machines write into the pages of docs/, and the table of figures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.bars import Figure, KnownMiss, Side, judge
from benchmarks.document import figures
from benchmarks.report import limits, number, ratio
from benchmarks.rows import Row

DOCS = Path(__file__).parents[1] / "docs"


def write(document: Mapping[str, Any]) -> None:
    """Write the table of figures into its page."""
    replace("figures.md", "figures", table(document))


def replace(page: str, name: str, table: str) -> None:
    """Replace the table between the marks of that name on a page of docs/."""
    file = DOCS / page
    file.write_text(between(file.read_text(encoding="utf-8"), name, table), encoding="utf-8")


def between(text: str, name: str, table: str) -> str:
    """Return the text with everything between the marks of that name replaced."""
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    head, rest = text.split(begin)
    _, tail = rest.split(end)
    return f"{head}{begin}\n{table}{end}{tail}"


def table(document: Mapping[str, Any]) -> str:
    """Return the figures as a table, with the machine and the versions of the run."""
    rows = [
        "| median (p99) | quadctl | raw Zenoh | ROS 1 | bar | |",
        "|---|---|---|---|---|---|",
        *(_row(row, figure) for row, figure in figures(document)),
    ]
    machine = document["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in machine["packages"].items())
    measured = (
        f"Measured by `make prove` on {machine['processor']}, Python {machine['python']},"
        f" {packages}, {machine['date']}, commit {machine['commit']}, load {machine['load']} before."
    )
    if speeds := machine.get("speeds"):  # figures from before this was measured have none
        measured += (
            f" A turn of a Python loop takes {speeds['loop']:.3g} ns there, a random read of memory"
            f" {speeds['read']:.3g} ns, a wake-up from sleep {speeds['wake'] / 1000:.3g} us."
        )
    return "\n".join([*rows, "", *_misses(document), measured]) + "\n"


def _misses(document: Mapping[str, Any]) -> list[str]:
    """Return the reasons of the rows that miss a bar, each reason once."""
    names: dict[KnownMiss, list[Row]] = {}
    for row, figure in figures(document):
        if row.known and judge(figure, row.bars) == "missed":
            names.setdefault(row.known, []).append(row)
    lines = [
        f"- {'; '.join(row.name for row in rows)} ({known.until.text(rows[0].unit)} until then): {known.why}"
        for known, rows in names.items()
    ]
    return (
        ["Why bars are missed, and the limit that holds meanwhile:", "", *lines, ""]
        if lines
        else []
    )


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
