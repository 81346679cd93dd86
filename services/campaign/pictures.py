"""Pictures of the report as SVG; their colours are variables of the page: light, dark or printed."""

import re
from collections.abc import Sequence
from io import StringIO
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from quadctl.services.campaign.tally import DECADES, LEAST, PARTS
from quadctl.services.campaign.track import Track

# Matplotlib knows no variables, so these colours stand for them until the SVG is written.
INK, QUIET, LINE, PATH, CAGE, BAD = _COLOURS = [f"#01020{number}" for number in range(6)]
_VARIABLES = dict(
    zip(_COLOURS, ("--ink", "--quiet", "--line", "--blue", "--cage", "--red"), strict=True)
)
_STYLE: dict[str, Any] = {
    "svg.fonttype": "none", "font.size": 11, "text.color": INK, "axes.labelcolor": QUIET,
    "xtick.color": QUIET, "ytick.color": QUIET, "axes.edgecolor": QUIET, "grid.color": LINE,
    "axes.grid": True, "axes.axisbelow": True, "grid.linewidth": 0.6, "axes.titlesize": 11,
    "axes.spines.top": False, "axes.spines.right": False, "axes.unicode_minus": True,
}  # fmt: skip
_DECADES = ("1 µm", "10 µm", "0.1 mm", "1 mm", "1 cm", "10 cm", "1 m", "10 m", "100 m")


def histogram(excursions: Sequence[int], margin: float | None) -> str:
    """Return the bars of `Tally.excursions`, with a line at the margin (m) if there is one."""
    with rc_context(_STYLE):
        figure = Figure(figsize=(8, 3), layout="constrained")
        axes = figure.add_subplot()
        # The flights without an excursion stand apart on the left.
        lefts = np.append(-2 * PARTS / 2, np.arange(DECADES * PARTS))
        widths = np.append(PARTS / 2, np.ones(DECADES * PARTS))
        bars = axes.bar(lefts, excursions, 0.92 * widths, align="edge", color=PATH, bottom=0)
        bars[0].set_color(CAGE)
        axes.set_yscale("log")
        axes.set_ylim(0.5, 2 * max(excursions))
        for left, width, count in zip(lefts, widths, excursions, strict=True):
            if count:
                place = left + 0.46 * width, count
                axes.annotate(
                    f"{count}", place, (0, 2), textcoords="offset points", ha="center",
                    fontsize=7, color=QUIET,
                )  # fmt: skip
        ticks = [lefts[0] + 0.46 * widths[0], *range(0, DECADES * PARTS + 1, PARTS)]
        axes.set_xticks(ticks, ["none", *_DECADES])
        axes.set(xlabel="worst excursion beyond the cage", ylabel="flights")
        axes.grid(visible=False, axis="x")
        if margin:
            place = PARTS * np.log10(margin / LEAST)
            axes.axvline(place, color=BAD, linestyle="--", linewidth=1.4)
            axes.annotate(
                " margin: beyond it, a violation", (place, 1), xycoords=("data", "axes fraction"),
                va="top", color=BAD, fontsize=9,
            )  # fmt: skip
        return _svg(figure, "excursions")


def flight(track: Track, at: float | None, name: str) -> str:
    """Return the path from above and the height over time; mark the time `at` (s).

    `name` differs for each picture of a page.
    """
    with rc_context(_STYLE):
        figure = Figure(figsize=(4.6, 6), layout="constrained")
        above, height = figure.subplots(2, height_ratios=(2.3, 1))
        _above(above, track, at)
        _height(height, track, at)
        return _svg(figure, name)


def _above(axes: Axes, track: Track, at: float | None) -> None:
    x, y, _ = track.positions.T
    present = len(track.times) - 1 if at is None else int(np.searchsorted(track.times, at))
    in_force = track.cages[min(present, len(track.cages) - 1)]
    sizes = np.unique(track.cages[~np.isnan(track.cages[:, 0])], axis=0)
    for cage_x, cage_y, _ in sizes:
        axes.add_patch(_cage(cage_x, cage_y, linestyle=":", linewidth=0.9))
    if not np.isnan(in_force[0]):
        axes.add_patch(_cage(in_force[0], in_force[1], linewidth=1.6))
    axes.plot(x, y, color=PATH, linewidth=1.2)
    axes.plot(x[0], y[0], "o", color=INK, markersize=4)
    if at is not None:
        axes.plot(*(np.interp(at, track.times, each) for each in (x, y)), **_MARK)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x, m", ylabel="y, m", title="from above")


_MARK: dict[str, Any] = {
    "marker": "o", "markersize": 11, "markerfacecolor": "none", "markeredgecolor": BAD,
    "markeredgewidth": 2, "zorder": 4, "linestyle": "none",
}  # fmt: skip


def _cage(x: float, y: float, **style: Any) -> Rectangle:
    return Rectangle((-x, -y), 2 * x, 2 * y, fill=False, edgecolor=CAGE, **style)


def _height(axes: Axes, track: Track, at: float | None) -> None:
    heights = track.positions[:, 2]
    axes.plot(track.times, track.cages[:, 2], color=CAGE, linewidth=1.6)
    axes.plot(track.times, heights, color=PATH, linewidth=1.2)
    if at is not None:
        axes.axvline(at, color=BAD, linewidth=1, linestyle=":")
        axes.plot(at, np.interp(at, track.times, heights), **_MARK)
    axes.set_ylim(bottom=min(0.0, heights.min()))
    axes.set(xlabel="time, s", ylabel="z, m", title="height, and the top of the cage")


def _svg(figure: Figure, name: str) -> str:
    """Return a figure as an element of HTML; `name` keeps its identifiers apart from others."""
    text = StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with rc_context({"svg.hashsalt": name}):
        figure.savefig(text, format="svg", transparent=True, metadata=nothing)
    svg = text.getvalue()
    svg = re.sub(r'<g id="[^"]*"', "<g", svg[svg.index("<svg") :])
    svg = re.sub(r"'DejaVu Sans'[^;\"]*", "system-ui, sans-serif", svg)
    svg = re.sub(r' (width|height)="[\d.]+pt"', "", svg, count=2)
    return re.sub("|".join(_COLOURS), lambda found: f"var({_VARIABLES[found[0]]})", svg)
