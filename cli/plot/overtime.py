"""The part of a flight's picture that shows how it went over time."""

from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import Any

from cli.plot import palette
from cli.plot.flight import Phase, Track

_BAR = 0.32
"""Half the height of a vehicle's bar, of its row."""


def height(axes: Any, tracks: dict[str, Track]) -> None:
    """The height, and the top of the cage while it was on."""
    shades = palette.of_vehicles(tracks)
    highest = 0.0
    for name, track in tracks.items():
        for count, leg in enumerate(track.legs):
            times, heights = [point[0] for point in leg], [point[3] for point in leg]
            axes.plot(times, heights, color=shades[name], label="" if count else name)
            highest = max(highest, *heights)
        for at in track.boots:
            axes.axvline(at, color=palette.CAGE, linestyle=":", linewidth=1)
        for (on, cage), spans in groupby(_spans(track), lambda span: span[0][2:]):
            whole = list(spans)
            if on:
                highest = max(highest, cage.z)
                ends = (whole[0][0].at, whole[-1][1])
                axes.plot(ends, (cage.z, cage.z), color=palette.CAGE, linestyle="--", linewidth=1.2)
    axes.set_ylim(min(0, axes.get_ylim()[0]), 1.12 * max(highest, 0.1))
    axes.set(title="height, and the top of the cage while it was on", ylabel="z, m")
    if len(tracks) > 1:
        axes.legend(loc="best", fontsize=8, ncols=2)


def pressure(axes: Any, tracks: dict[str, Track]) -> None:
    """The raw pressure above its first value, and what the topic shows once it is zeroed."""
    shades = palette.of_vehicles(tracks)
    alone = len(tracks) == 1
    for name, track in tracks.items():
        if not track.air:
            continue
        raw = [(at, shown + baseline) for at, shown, baseline in track.air]
        axes.plot(
            [at for at, _ in raw],
            [value - raw[0][1] for _, value in raw],
            color=palette.CAGE if alone else shades[name],
            linewidth=1,
            label="raw, above its first value" if alone else name,
        )
        zeroed = [(at, shown) if baseline else (at, None) for at, shown, baseline in track.air]
        if alone and any(shown is not None for _, shown in zeroed):
            axes.plot(
                [at for at, _ in zeroed],
                _with_gaps(zeroed),
                color=palette.AIR,
                label="sensors/pressure, zeroed",
            )
            began = next(at for at, shown in zeroed if shown is not None)
            axes.axvline(began, color=palette.TAKEN, linestyle=":", label="calibrate")
    title = (
        "pressure before and after calibration" if alone else "raw pressure, above its first value"
    )
    axes.set(title=title, ylabel="hPa")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="center right", fontsize=8)


def states(axes: Any, tracks: dict[str, Track]) -> None:
    """Safety's states as bars, a vehicle a row, the cage as a line under them."""
    from matplotlib.patches import Patch

    for row, track in enumerate(tracks.values()):
        for phase, end in _spans(track):
            # VERIFYING lasts one step: as wide as a line, or it would not be seen.
            width = max(end - phase.at, track.end / 400)
            if phase.state == "VERIFYING":
                axes.axvline(phase.at, color=palette.STATES[phase.state], linewidth=1.2, zorder=3)
            else:
                bar = [(phase.at, width)]
                axes.broken_barh(bar, (row - _BAR, 2 * _BAR), color=palette.STATES[phase.state])
            colour = palette.TAKEN if phase.cage_on else palette.REFUSED
            axes.plot((phase.at, end), (row - 0.42, row - 0.42), color=colour, linewidth=3)
        refused = [spot.at for spot in track.refused]
        axes.scatter(refused, [row] * len(refused), s=40, c=palette.REFUSED, marker="x", zorder=4)
    axes.set_yticks(range(len(tracks)), list(tracks) if len(tracks) > 1 else ["safety"])
    axes.set_ylim(-0.6, len(tracks) - 0.4)
    handles = [Patch(color=colour, label=name) for name, colour in palette.STATES.items()]
    handles += [
        Patch(color=palette.TAKEN, label="cage on"),
        Patch(color=palette.REFUSED, label="cage off"),
    ]
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.32), ncols=5, fontsize=8,
        frameon=False, handlelength=1.2, columnspacing=1.2,
    )  # fmt: skip
    axes.set(title="safety's states, and the cage")


def _spans(track: Track) -> list[tuple[Phase, float]]:
    """Each phase with the time (s) at which the next one began."""
    pairs = [(phase, after.at) for phase, after in pairwise(track.phases)]
    return [*pairs, (track.phases[-1], track.end)] if track.phases else []


def _with_gaps(points: Sequence[tuple[float, float | None]]) -> list[float]:
    return [float("nan") if value is None else value for _, value in points]
