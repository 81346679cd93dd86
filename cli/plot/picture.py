"""The picture of a flight: its path in the cage from above and the side, and how it went in time."""

from pathlib import Path
from typing import Any

from cli.plot import overtime
from cli.plot.flight import Flight, Spot, Track
from cli.plot.palette import CAGE, REFUSED, TAKEN, of_vehicles
from schemas.messages import CageSize
from services.runtime.errors import Invalid, QuadctlError

_LAYOUT: Any = [["above", "height"], ["above", "pressure"], ["side", "states"]]
_TIME = "simulated time, s"


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

    figure, axes = plt.subplot_mosaic(
        _LAYOUT,
        figsize=(12, 7.5),
        width_ratios=(1.15, 1),
        height_ratios=(1.45, 1, 0.85),
        layout="constrained",
    )
    tracks = flight.flown()
    _views(axes["above"], axes["side"], tracks)
    overtime.height(axes["height"], tracks)
    overtime.pressure(axes["pressure"], tracks)
    overtime.states(axes["states"], tracks)
    begin = min(track.path[0][0] for track in tracks.values())
    for name in ("height", "pressure", "states"):
        axes[name].set_xlim(begin, max(begin + 0.1, *(track.end for track in tracks.values())))
        axes[name].grid(alpha=0.3)
    axes["states"].set_xlabel(_TIME)
    figure.suptitle(title, fontsize=14)
    try:
        figure.savefig(file, dpi=120)
    except OSError as error:
        raise QuadctlError(
            f"{file} cannot be written: {error.strerror}", "name a place that you may write to: -o"
        ) from error
    finally:
        plt.close(figure)


def _views(above: Any, side: Any, tracks: dict[str, Track]) -> None:
    """The paths against x: y from above, z from the side."""
    shades = of_vehicles(tracks)
    cages = list(dict.fromkeys(p.cage for track in tracks.values() for p in track.phases))
    for axes, up, name in ((above, 2, "y"), (side, 3, "z")):
        for cage in cages:
            _outline(axes, cage, name)
        for vehicle, track in tracks.items():
            across = [point[1] for point in track.path]
            ups = [point[up] for point in track.path]
            label = "path" if len(tracks) == 1 else vehicle
            axes.plot(across, ups, color=shades[vehicle], linewidth=1.5, label=label)
        for spots, marker, colour, label in (
            ([s for t in tracks.values() for s in t.taken], "o", TAKEN, "accepted"),
            ([s for t in tracks.values() for s in t.refused], "x", REFUSED, "rejected"),
        ):
            _spots(axes, spots, up, marker, colour, label)
        axes.margins(0.08)
        axes.set_aspect("equal", adjustable="datalim")
        title = "path from above" if name == "y" else "path from the side"
        axes.set(title=title, xlabel="x, m", ylabel=f"{name}, m")
        axes.grid(alpha=0.3)
    handles, labels = side.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    above.legend(unique.values(), unique, loc="upper left", fontsize=9, framealpha=0.9)


def _spots(axes: Any, spots: list[Spot], up: int, marker: str, colour: str, label: str) -> None:
    if spots:
        x, ups = [spot[1] for spot in spots], [spot[up] for spot in spots]
        axes.scatter(x, ups, 60, colour, marker, label=label, zorder=3)


def _outline(axes: Any, cage: CageSize, name: str) -> None:
    from matplotlib.patches import Rectangle

    low, extent = (-cage.y, 2 * cage.y) if name == "y" else (0.0, cage.z)
    outline = Rectangle((-cage.x, low), 2 * cage.x, extent)
    outline.set(fill=False, edgecolor=CAGE, linestyle="--", linewidth=1.5, label="cage")
    axes.add_patch(outline)
