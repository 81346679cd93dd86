"""Picture of a flight as a matplotlib figure."""

import math
import os
from collections.abc import Iterable
from io import BytesIO
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

from quadctl.cli.plot.track import Phase, RecordedFlight, Spot, Track
from quadctl.schemas.messages import CageSize, Zone
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.files import write_whole
from quadctl.services.runtime.realm import spare_folder

CAGE, TAKEN, REFUSED, AIR = "#57606a", "#1a7f37", "#cf222e", "#8250df"
STATES = {"HOVERING": "#c9d1d9", "VERIFYING": "#d4a72c", "MOVING": "#79c0ff"}
_PATHS = ("#1f6feb", "#bf5af2", "#e36209", "#0a7f8c", "#8a6d00", "#c2185b", "#2f5d00", "#444c56")


def of_vehicles(names: Iterable[str]) -> dict[str, str]:
    """Return a colour for each vehicle; colours repeat from the first if there are too few."""
    return {name: _PATHS[number % len(_PATHS)] for number, name in enumerate(names)}


_CROWD = 12
"""Most vehicles that a legend names: more would hide the picture."""
_BAR = 0.32  # half the height of a vehicle's bar, in rows


def height(axes: Any, tracks: dict[str, Track]) -> None:
    """Draw the height, and the top of the cage while it was on."""
    shades = of_vehicles(tracks)
    highest = 0.0
    for name, track in tracks.items():
        for count, leg in enumerate(track.legs):
            times, heights = [point[0] for point in leg], [point[3] for point in leg]
            axes.plot(times, heights, color=shades[name], label="" if count else name)
            highest = max(highest, *heights)
        for at in track.boots:
            axes.axvline(at, color=CAGE, linestyle=":", linewidth=1)
        for (on, cage), spans in groupby(_spans(track), lambda span: span[0][2:]):
            whole = list(spans)
            if on:
                highest = max(highest, cage.z)
                ends = (whole[0][0].at, whole[-1][1])
                axes.plot(ends, (cage.z, cage.z), color=CAGE, linestyle="--", linewidth=1.2)
    axes.set_ylim(min(0, axes.get_ylim()[0]), 1.12 * max(highest, 0.1))
    axes.set(title="height, and the top of the cage while it was on", ylabel="z, m")
    if 1 < len(tracks) <= _CROWD:
        axes.legend(loc="best", fontsize=8, ncols=2)


def pressure(axes: Any, tracks: dict[str, Track]) -> None:
    """Draw the raw pressure above its first value, and the topic's value once it is zeroed."""
    shades = of_vehicles(tracks)
    alone = len(tracks) == 1
    for name, track in tracks.items():
        if not track.air:
            continue
        raw = [(at, shown + baseline) for at, shown, baseline in track.air]
        axes.plot(
            [at for at, _ in raw],
            [value - raw[0][1] for _, value in raw],
            color=CAGE if alone else shades[name],
            linewidth=1,
            label="raw, above its first value" if alone else name,
        )
        began = next((at for at, _, baseline in track.air if baseline), None)
        if alone and began is not None:
            # NaN before a calibration leaves a gap in the line.
            zeroed = [shown if baseline else math.nan for _, shown, baseline in track.air]
            times = [at for at, _ in raw]
            axes.plot(times, zeroed, color=AIR, label="sensors/pressure, zeroed")
            axes.axvline(began, color=TAKEN, linestyle=":", label="calibrate")
    title = (
        "pressure before and after calibration" if alone else "raw pressure, above its first value"
    )
    axes.set(title=title, ylabel="hPa")
    if axes.get_legend_handles_labels()[0] and len(tracks) <= _CROWD:
        axes.legend(loc="center right", fontsize=8)


def states(axes: Any, tracks: dict[str, Track]) -> None:
    """Draw safety's states as bars, one row per vehicle, the cage as a line under each."""
    from matplotlib.patches import Patch

    for row, track in enumerate(tracks.values()):
        for phase, end in _spans(track):
            # VERIFYING lasts one step: a bar of its true width would be invisible.
            width = max(end - phase.at, track.end / 400)
            if phase.state == "VERIFYING":
                axes.axvline(phase.at, color=STATES[phase.state], linewidth=1.2, zorder=3)
            else:
                bar = [(phase.at, width)]
                axes.broken_barh(bar, (row - _BAR, 2 * _BAR), color=STATES[phase.state])
            colour = TAKEN if phase.cage_on else REFUSED
            axes.plot((phase.at, end), (row - 0.42, row - 0.42), color=colour, linewidth=3)
        refused = [spot.at for spot in track.refused]
        axes.scatter(refused, [row] * len(refused), s=40, c=REFUSED, marker="x", zorder=4)
    every = -(-len(tracks) // _CROWD)
    named = range(0, len(tracks), every)
    names = list(tracks) if len(tracks) > 1 else ["safety"]
    axes.set_yticks(named, [names[row] for row in named])
    axes.set_ylim(-0.6, len(tracks) - 0.4)
    handles = [Patch(color=colour, label=name) for name, colour in STATES.items()]
    handles += [Patch(color=TAKEN, label="cage on"), Patch(color=REFUSED, label="cage off")]
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.32), ncols=5, fontsize=8,
        frameon=False, handlelength=1.2, columnspacing=1.2,
    )  # fmt: skip
    axes.set(title="safety's states, and the cage")


def _spans(track: Track) -> list[tuple[Phase, float]]:
    """Return each phase with the time (s) at which the next one began."""
    pairs = [(phase, after.at) for phase, after in pairwise(track.phases)]
    return [*pairs, (track.phases[-1], track.end)] if track.phases else []


_LAST: dict[str, Any] = {"marker": "D", "markersize": 5, "markevery": [-1]}
"""Mark of the last position in each boot."""


def draw(file: Path, flight: RecordedFlight, title: str) -> None:
    """Write the picture, PNG or SVG by its ending; raise Invalid for others, or without poses."""
    if file.suffix.lower() not in {".png", ".svg"}:
        raise Invalid(f"{file}: no such picture format", "use a name ending in .png or .svg")
    if not flight.flown():
        raise Invalid(
            "nothing to draw: there is no pose in it",
            "`quadctl bag info` shows what a recording has",
        )
    _make_settings_folder()
    from matplotlib.figure import Figure

    tracks = flight.flown()
    figure = Figure(figsize=(12, 7.5), layout="constrained")
    columns = figure.add_gridspec(1, 2, width_ratios=(1.1, 1))
    _views(figure, columns[0], tracks)
    _courses(figure, columns[1], tracks)
    figure.suptitle(title, fontsize=14)
    picture = BytesIO()
    figure.savefig(picture, format=file.suffix[1:].lower(), dpi=120)
    write_whole(file, picture.getvalue())


def _make_settings_folder() -> None:
    """Give matplotlib a folder of this user's for its settings where no home can be written to."""
    home = os.environ.get("HOME", "")
    if "MPLCONFIGDIR" not in os.environ and home and not os.access(home, os.W_OK):
        os.environ["MPLCONFIGDIR"] = str(spare_folder("matplotlib"))


def _views(figure: Any, place: Any, tracks: dict[str, Track]) -> None:
    """Draw the paths over x, with y from above and z from the side, on one scale."""
    cages = list(dict.fromkeys(p.cage for track in tracks.values() for p in track.phases))
    spots = [s for t in tracks.values() for s in (*t.accepted, *t.refused)]
    points = [point for track in tracks.values() for point in track.path] + spots
    spans = [_span([point[axis] for point in points], axis, cages) for axis in (1, 2, 3)]
    (_, (left, right)), (depth, _), (tall, _) = ((high - low, (low, high)) for low, high in spans)
    grid = place.subgridspec(2, 1, height_ratios=(depth, max(tall, 0.2 * depth)))
    above, side = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    for axes, up, name in ((above, 2, "y"), (side, 3, "z")):
        for cage in cages:
            _outline(axes, cage, name)
        for zone in dict.fromkeys(zone for track in tracks.values() for zone in track.zones):
            _column(axes, zone, name, spans[2])
        for vehicle, shade in of_vehicles(tracks).items():
            label = "path" if len(tracks) == 1 else vehicle
            label = label if len(tracks) <= _CROWD else "paths"
            for leg in tracks[vehicle].legs:
                across, ups = [point[1] for point in leg], [point[up] for point in leg]
                # A vehicle at rest has no line, only the mark of its last position.
                axes.plot(across, ups, color=shade, linewidth=1.5, label=label, **_LAST)
        _spots(axes, [s for t in tracks.values() for s in t.accepted], up, "o", TAKEN, "accepted")
        _spots(axes, [s for t in tracks.values() for s in t.refused], up, "x", REFUSED, "rejected")
        axes.set_aspect("equal")
        axes.set(xlim=(left, right), ylim=spans[up - 1], xlabel="x, m", ylabel=f"{name}, m")
        axes.set_title("path from above" if name == "y" else "path from the side")
        axes.grid(alpha=0.3)
    handles, labels = side.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    below = (0.5, -0.2 * max(1.0, depth / max(tall, 0.2 * depth) / 2))
    side.legend(
        unique.values(), unique, loc="upper center", bbox_to_anchor=below, ncols=6, frameon=False,
        fontsize=9,
    )  # fmt: skip


def _courses(figure: Any, place: Any, tracks: dict[str, Track]) -> None:
    """Draw height, pressure and states over one axis of time."""
    grid = place.subgridspec(3, 1, height_ratios=(1.45, 1, 0.85))
    begin = min(track.legs[0][0][0] for track in tracks.values())
    end = max(begin + 0.1, *(track.end for track in tracks.values()))
    for row, show in enumerate((height, pressure, states)):
        axes = figure.add_subplot(grid[row])
        show(axes, tracks)
        axes.set_xlim(begin, end)
        axes.grid(alpha=0.3)
        axes.set_xlabel("simulated time, s" if show is states else "")


def _span(values: list[float], axis: int, cages: list[CageSize]) -> tuple[float, float]:
    """Return the range of the values and the cages' walls, with some room."""
    walls = [(-c.x, c.x, -c.y, c.y, 0.0, c.z)[2 * axis - 2 : 2 * axis] for c in cages]
    low = min(*values, *(wall[0] for wall in walls), 0.0)
    high = max(*values, *(wall[1] for wall in walls), 0.1)
    room = 0.06 * (high - low)
    return low - room, high + room


def _spots(axes: Any, spots: list[Spot], up: int, marker: str, colour: str, label: str) -> None:
    if spots:
        x, ups = [spot[1] for spot in spots], [spot[up] for spot in spots]
        axes.scatter(x, ups, s=60, c=colour, marker=marker, label=label, zorder=3)


def _column(axes: Any, zone: Zone, name: str, heights: tuple[float, float]) -> None:
    """Draw a zone from above, or as its bounds between heights (m) from the side."""
    from matplotlib.patches import Circle, Polygon, Rectangle

    shape: Any
    circle = zone.circle
    if name == "z":
        low, high = max(zone.floor, heights[0]), min(zone.ceiling, heights[1])
        across = [x for x, _ in zone.polygon]
        left = min(across, default=circle.x - circle.radius)
        right = max(across, default=circle.x + circle.radius)
        shape = Rectangle((left, low), right - left, high - low)
    elif zone.polygon:
        shape = Polygon(zone.polygon, closed=True)
    else:
        shape = Circle((circle.x, circle.y), circle.radius)
    colour = REFUSED if zone.kind == "exclusion" else TAKEN
    shape.set(
        fill=False, edgecolor=colour, hatch="//" if zone.kind == "exclusion" else "", alpha=0.5
    )
    shape.set(label=f"{zone.kind} zone")
    axes.add_patch(shape)


def _outline(axes: Any, cage: CageSize, name: str) -> None:
    from matplotlib.patches import Rectangle

    low, extent = (-cage.y, 2 * cage.y) if name == "y" else (0.0, cage.z)
    outline = Rectangle((-cage.x, low), 2 * cage.x, extent)
    outline.set(fill=False, edgecolor=CAGE, linestyle="--", linewidth=1.5, label="cage")
    axes.add_patch(outline)
