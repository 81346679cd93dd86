"""File of figures: a run writes it; tables and verdicts read it."""

from collections.abc import Mapping
from typing import Any

import msgspec

from benchmarks.bars import Figure, judge
from benchmarks.rows import BY_KEY, Row


def entry(row: Row, figure: Figure) -> dict[str, Any]:
    """Return a row and its figure for JSON."""
    about = {
        "key": row.key,
        "group": row.group,
        "name": row.name,
        "unit": row.unit,
        "bars": [bar.text(row.unit) for bar in row.bars],
        "verdict": judge(figure, row.bars),
    }
    measured: dict[str, Any] = msgspec.to_builtins(figure)
    return about | measured


def figures(document: Mapping[str, Any]) -> list[tuple[Row, Figure]]:
    """Return the rows of a file with their figures; the bars come from the table, not the file."""
    return [
        (BY_KEY[found["key"]], msgspec.convert(found, Figure))
        for found in document["figures"]
        if found["key"] in BY_KEY
    ]
