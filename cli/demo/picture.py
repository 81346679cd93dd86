"""The picture of a flight: its path in the cage from above and from the side, height, pressure."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cli.demo.checkpoints import Lab
from schemas.geometry import Position
from schemas.messages import Pose, Pressure
from services.runtime import wire
from services.runtime.hearing import Message

_PATH, _CAGE, _TAKEN, _REFUSED, _AIR = "#1f6feb", "#57606a", "#1a7f37", "#cf222e", "#8250df"


def draw(file: Path, lab: Lab, messages: list[Message]) -> None:
    """Write the picture of what was flown; the ending says whether PNG or SVG."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    poses, readings = _decode(messages)
    path = np.array([(p.stamp, p.position.x, p.position.y, p.position.z) for p in poses])
    air = np.array([(r.stamp, r.pressure, r.baseline) for r in readings])
    size = lab.params.safety.virtual_cage
    figure, axes = plt.subplot_mosaic(
        [["above", "height"], ["above", "pressure"], ["side", "pressure"]],
        figsize=(12, 7.5),
        width_ratios=(1.15, 1),
        height_ratios=(1.6, 1, 0.7),
        layout="constrained",
    )
    _view(axes["above"], lab, path[:, 1], path[:, 2], "y", (-size.y, 2 * size.y))
    _view(axes["side"], lab, path[:, 1], path[:, 3], "z", (0.0, size.z))
    axes["side"].legend(loc="upper center", bbox_to_anchor=(0.5, -0.55), ncols=4, frameon=False)
    _height(axes["height"], path, size.z)
    _pressure(axes["pressure"], air)
    figure.suptitle("quadctl demo: the lab's four checkpoints, flown", fontsize=14)
    figure.savefig(file, dpi=120)
    plt.close(figure)


def _decode(messages: list[Message]) -> tuple[list[Pose], list[Pressure]]:
    poses = [m for m in messages if m.key.endswith("/pose")]
    readings = [m for m in messages if m.key.endswith("/pressure")]
    return (
        [wire.decode(Pose, m.payload, m.encoding) for m in poses],
        [wire.decode(Pressure, m.payload, m.encoding) for m in readings],
    )


def _view(
    axes: Any, lab: Lab, across: NDArray[Any], up: NDArray[Any], axis: str, side: Any
) -> None:
    """The path against x and another axis, in the cage's outline `side` = (lowest, extent)."""
    from matplotlib.patches import Rectangle

    def spots(goals: list[Position], marker: str, colour: str, label: str) -> None:
        ups = [getattr(goal, axis) for goal in goals]
        axes.scatter([g.x for g in goals], ups, 70, colour, marker, label=label, zorder=3)

    reach = lab.params.safety.virtual_cage.x
    low, extent = side
    outline = Rectangle((-reach, low), 2 * reach, extent)
    outline.set(fill=False, edgecolor=_CAGE, linestyle="--", linewidth=1.5, label="cage")
    axes.add_patch(outline)
    axes.plot(across, up, color=_PATH, linewidth=1.5, label="path")
    spots(lab.accepted, "o", _TAKEN, "accepted")
    spots(lab.rejected, "x", _REFUSED, "rejected")
    axes.margins(0.08)
    axes.set_aspect("equal", anchor="W")
    title = "path from above" if axis == "y" else "path from the side"
    axes.set(title=title, xlabel="x, m", ylabel=f"{axis}, m")
    axes.grid(alpha=0.3)


def _height(axes: Any, path: NDArray[Any], ceiling: float) -> None:
    axes.plot(path[:, 0], path[:, 3], color=_PATH)
    axes.axhline(ceiling, color=_CAGE, linestyle="--")
    axes.annotate(
        "top of the cage",
        (path[-1, 0], ceiling),
        (0, -12),
        ha="right",
        fontsize=9,
        color=_CAGE,
        textcoords="offset points",
    )
    axes.set_ylim(0, 1.1 * max(ceiling, path[:, 3].max()))
    axes.set(title="height", xlabel="simulated time, s", ylabel="z, m")
    axes.grid(alpha=0.3)


def _pressure(axes: Any, air: NDArray[Any]) -> None:
    """What the topic shows, the baseline given back before it and left off after it."""
    zeroed = air[:, 2] != 0
    raw = air[:, 1] + air[:, 2]
    axes.plot(air[:, 0], raw - raw[0], color=_CAGE, linewidth=1, label="raw, above its first value")
    axes.plot(air[zeroed, 0], air[zeroed, 1], color=_AIR, label="sensors/pressure, zeroed")
    if zeroed.any():
        axes.axvline(air[zeroed, 0][0], color=_TAKEN, linestyle=":", label="calibrate")
    axes.set(
        title="pressure before and after calibration", xlabel="simulated time, s", ylabel="hPa"
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize=9)
