"""Text of figures: lines for the terminal, cells for a table. Pure."""

from benchmarks.bars import NAMES, Figure, Side, judge
from benchmarks.rows import Row


def line(row: Row, figure: Figure) -> str:
    """Return the line that is printed for a row during the run."""
    verdict = judge(figure, row.bars)
    if verdict == "failed":
        return f"{row.name:48} FAILED: {figure.error}"
    ours = figure.sides["ours"]
    tail = "p1" if row.more_is_better else "p99"
    peers = "".join(
        f" | {NAMES[side]} {number(summary.median)}, ratio {ratio(figure, side)}"
        for side, summary in figure.sides.items()
        if side != "ours"
    )
    bars = f" | {limits(row)}: {verdict.upper()}" if row.bars else ""
    missing = "".join(f" | {NAMES[side]} {why}" for side, why in figure.missing.items())
    measured = f"{number(ours.median):>7} {row.unit:3} ({tail} {number(ours.tail)}, n {ours.n})"
    return f"{row.name:48} {measured}{peers}{missing}{bars}"


def limits(row: Row) -> str:
    """Return the row's bars as text."""
    return ", ".join(bar.text(row.unit) for bar in row.bars)


def ratio(figure: Figure, peer: Side) -> str:
    """Return the median ratio of ours to a peer's as text."""
    found = figure.ratio(peer)
    return "-" if found is None else number(found)


def number(value: float) -> str:
    """Return three significant digits, without an exponent if possible."""
    if value == 0 or abs(value) >= 1000:
        return f"{value:.0f}"
    return f"{value:.3g}"
