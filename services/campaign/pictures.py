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

from quadctl.services.campaign.breakdown import DECADES, LEAST, PARTS
from quadctl.services.campaign.track import FlightTrack
from quadctl.services.campaign.watch import Floats

# Matplotlib knows no variables, so these colours stand for them until the SVG is written.
INK, QUIET, LINE, PATH, CAGE, BAD = _COLOURS = [f"#01020{number}" for number in range(6)]
_VARIABLES = dict(
    zip(_COLOURS, ("--ink", "--quiet", "--line", "--blue", "--cage", "--red"), strict=True)
)
_STYLE: Any = {
    "svg.fonttype": "none", "font.size": 11, "text.color": INK, "axes.labelcolor": QUIET,
    "xtick.color": QUIET, "ytick.color": QUIET, "axes.edgecolor": QUIET, "grid.color": LINE,
    "axes.grid": True, "axes.axisbelow": True, "grid.linewidth": 0.6, "axes.titlesize": 11,
    "axes.spines.top": False, "axes.spines.right": False,
}  # fmt: skip
_DECADES = ("1 µm", "10 µm", "0.1 mm", "1 mm", "1 cm", "10 cm", "1 m", "10 m", "100 m")


def histogram(excursions: Sequence[int], margin: float | None) -> str:
    """Return the bars of `Breakdown.excursions`, with a line at the margin (m) if there is one."""
    with rc_context(_STYLE):
        figure = Figure(figsize=(10, 3.2), layout="constrained")
        axes = figure.add_subplot()
        # The flights without an excursion stand apart on the left, in a wider bar.
        middles = np.append(-0.75 * PARTS, np.arange(DECADES * PARTS) + 0.5)
        widths = np.append(0.5 * PARTS, np.full(DECADES * PARTS, 0.92))
        bars = axes.bar(middles, excursions, widths, color=PATH)
        bars[0].set_color(CAGE)
        axes.bar_label(
            bars, [_short(n) if n else "" for n in excursions], padding=2, fontsize=7, color=QUIET
        )
        axes.set_yscale("log")
        axes.set_ylim(0.5, 3 * max(excursions))
        axes.yaxis.set_major_formatter(lambda count, _: _short(int(count)))
        axes.set_xticks([middles[0], *range(0, DECADES * PARTS + 1, PARTS)], ["none", *_DECADES])
        axes.set(xlabel="worst excursion beyond the cage", ylabel="flights")
        axes.grid(visible=False, axis="x")
        if margin:
            place = PARTS * np.log10(margin / LEAST)
            axes.axvline(place, color=BAD, linestyle="--", linewidth=1.4)
            axes.annotate(
                "margin: beyond it is a violation", (place, 1), (4, 0),
                ("data", "axes fraction"), "offset points", va="top", color=BAD, fontsize=9,
            )  # fmt: skip
        return _svg(figure, "excursions")


def _short(count: int) -> str:
    """Return a number without most of its digits, which would not fit."""
    for letter, size in (("M", 1_000_000), ("k", 1000)):
        if count >= size:
            return f"{count / size:.3g}{letter}"
    return f"{count}"


def flight(track: FlightTrack, at: float | None, name: str) -> str:
    """Return the path from above and the height over time; mark the time `at` (s).

    `name` differs for each picture of a page.
    """
    with rc_context(_STYLE):
        figure = Figure(figsize=(4.6, 6), layout="constrained")
        above, height = figure.subplots(2, height_ratios=(2.3, 1))
        _above(above, track, at)
        _height(height, track, at)
        figure.align_ylabels()
        return _svg(figure, name)


def _above(axes: Axes, track: FlightTrack, at: float | None) -> None:
    x, y, _ = track.positions.T
    # A cage that changes at this very time did not apply yet.
    in_force = track.cages[-1 if at is None else max(int(np.searchsorted(track.times, at)) - 1, 0)]
    sizes = np.unique(track.cages[~np.isnan(track.cages[:, 0])], axis=0)
    for cage_x, cage_y, _ in sizes:
        axes.add_patch(_cage(cage_x, cage_y, linestyle=":", linewidth=0.9))
    if not np.isnan(in_force[0]):
        axes.add_patch(_cage(in_force[0], in_force[1], linewidth=2.5))
    _path(axes, track, x, y)
    axes.plot(x[0], y[0], "o", color=INK, markersize=4)
    if at is not None:
        axes.plot(*(np.interp(at, track.times, each) for each in (x, y)), **_MARK)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x, m", ylabel="y, m", title="from above")


def _path(axes: Axes, track: FlightTrack, across: Floats, up: Floats) -> None:
    """Draw a path, pale while the cage was off."""
    caged = np.where(np.isnan(track.cages[:, 0]), np.nan, up)
    axes.plot(across, up, color=PATH, linewidth=1.2, alpha=0.45)
    axes.plot(across, caged, color=PATH, linewidth=1.2)


_MARK: dict[str, Any] = {
    "marker": "o", "markersize": 11, "markerfacecolor": "none", "markeredgecolor": BAD,
    "markeredgewidth": 2, "zorder": 4, "linestyle": "none",
}  # fmt: skip


def _cage(x: float, y: float, **style: Any) -> Rectangle:
    return Rectangle((-x, -y), 2 * x, 2 * y, fill=False, edgecolor=CAGE, **style)


def _height(axes: Axes, track: FlightTrack, at: float | None) -> None:
    heights = track.positions[:, 2]
    axes.plot(track.times, track.cages[:, 2], color=CAGE, linewidth=2.5)
    _path(axes, track, track.times, heights)
    if at is not None:
        axes.axvline(at, color=BAD, linewidth=1, linestyle=":")
        axes.plot(at, np.interp(at, track.times, heights), **_MARK)
    axes.set_ylim(min(0.0, heights.min()), 1.15 * axes.dataLim.y1)
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
