"""The picture of a flight: its path in the cage from above and the side, and how it went in time."""

from pathlib import Path
from typing import Any

from cli.plot import overtime
from cli.plot.flight import Flight, Spot, Track
from cli.plot.palette import CAGE, REFUSED, TAKEN, of_vehicles
from schemas.messages import CageSize
from services.runtime.errors import Invalid, QuadctlError

_TIME = "simulated time, s"
_LAST: dict[str, Any] = {"marker": "D", "markersize": 5, "markevery": [-1]}
"""The mark where a vehicle was at the end, of each boot."""


def draw(file: Path, flight: Flight, title: str) -> None:
    """Write the picture; the ending says whether PNG or SVG.

    Raises Invalid for another ending, or where nothing was flown.
    """
    if file.suffix.lower() not in {".png", ".svg"}:
        raise Invalid(f"{file}: no picture is written so", "end it in .png or .svg")
    if not flight.flown():
        raise Invalid("there is nothing to draw: no pose came", "`quadctl topic hz pose`")
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    tracks = flight.flown()
    figure = plt.figure(figsize=(12, 7.5), layout="constrained")
    columns = figure.add_gridspec(1, 2, width_ratios=(1.1, 1))
    _views(figure, columns[0], tracks)
    _courses(figure, columns[1], tracks)
    figure.suptitle(title, fontsize=14)
    try:
        figure.savefig(file, dpi=120)
    except OSError as error:
        raise QuadctlError(
            f"{file} cannot be written: {error.strerror}", "name a place that you may write to: -o"
        ) from error
    finally:
        plt.close(figure)


def _views(figure: Any, place: Any, tracks: dict[str, Track]) -> None:
    """The paths against x, y from above and z from the side, on one scale."""
    cages = list(dict.fromkeys(p.cage for track in tracks.values() for p in track.phases))
    spots = [s for t in tracks.values() for s in (*t.taken, *t.refused)]
    points = [point for track in tracks.values() for point in track.path] + spots
    spans = [_span([point[axis] for point in points], axis, cages) for axis in (1, 2, 3)]
    (_, (left, right)), (depth, _), (tall, _) = ((high - low, (low, high)) for low, high in spans)
    grid = place.subgridspec(2, 1, height_ratios=(depth, max(tall, 0.2 * depth)))
    above, side = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    for axes, up, name in ((above, 2, "y"), (side, 3, "z")):
        for cage in cages:
            _outline(axes, cage, name)
        for vehicle, shade in of_vehicles(tracks).items():
            label = "path" if len(tracks) == 1 else vehicle
            for leg in tracks[vehicle].legs:
                across, ups = [point[1] for point in leg], [point[up] for point in leg]
                # Of one that stood still there would be no line; its last place has a mark.
                axes.plot(across, ups, color=shade, linewidth=1.5, label=label, **_LAST)
        _spots(axes, [s for t in tracks.values() for s in t.taken], up, "o", TAKEN, "accepted")
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
    """What there was over time, on one axis of time."""
    grid = place.subgridspec(3, 1, height_ratios=(1.45, 1, 0.85))
    begin = min(track.legs[0][0][0] for track in tracks.values())
    end = max(begin + 0.1, *(track.end for track in tracks.values()))
    for row, show in enumerate((overtime.height, overtime.pressure, overtime.states)):
        axes = figure.add_subplot(grid[row])
        show(axes, tracks)
        axes.set_xlim(begin, end)
        axes.grid(alpha=0.3)
        axes.set_xlabel(_TIME if show is overtime.states else "")


def _span(values: list[float], axis: int, cages: list[CageSize]) -> tuple[float, float]:
    """From the lowest to the highest of the values and the cages' walls, with some room."""
    walls = [(-c.x, c.x, -c.y, c.y, 0.0, c.z)[2 * axis - 2 : 2 * axis] for c in cages]
    low = min(*values, *(wall[0] for wall in walls), 0.0)
    high = max(*values, *(wall[1] for wall in walls), 0.1)
    room = 0.06 * (high - low)
    return low - room, high + room


def _spots(axes: Any, spots: list[Spot], up: int, marker: str, colour: str, label: str) -> None:
    if spots:
        x, ups = [spot[1] for spot in spots], [spot[up] for spot in spots]
        axes.scatter(x, ups, s=60, c=colour, marker=marker, label=label, zorder=3)


def _outline(axes: Any, cage: CageSize, name: str) -> None:
    from matplotlib.patches import Rectangle

    low, extent = (-cage.y, 2 * cage.y) if name == "y" else (0.0, cage.z)
    outline = Rectangle((-cage.x, low), 2 * cage.x, extent)
    outline.set(fill=False, edgecolor=CAGE, linestyle="--", linewidth=1.5, label="cage")
    axes.add_patch(outline)
