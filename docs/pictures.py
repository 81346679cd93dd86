"""Command that draws the pictures of README and the book: `python -m docs.pictures [NAME...]`.

Without a name it draws all. Each but the architecture shows a flight that it flies.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.animation import FuncAnimation, PillowWriter

import quadctl
from docs import screens, swap

_DOCS = Path(__file__).parent
_GOALS = ((3.0, 2.0, 1.5), (7.0, 0.0, 1.0), (-3.0, -3.0, 3.0), (0.0, 0.0, 1.0))
"""Goals, m; the second is outside the cage."""
_SPEED = 10
"""Simulated seconds per second of the flight."""
_RATE, _FRAMES = 10, 8
"""Frames per simulated second, and frames per second of the picture."""
_CAGE = 5.0
"""Bound of the cage in x and y, and its height, m."""
_TAIL = 1.0
"""Seconds of the picture after the last arrival."""
_READ = 1.5
"""Simulated seconds to read that a goal is rejected."""

Goal = tuple[float, float, float]


def flown(file: Path) -> list[tuple[float, Goal, str]]:
    """Fly to each goal and record it; return when each was requested (simulated s), and the verdict."""
    verdicts = []
    with quadctl.launch(params={"dynamics.speed": _SPEED}, record=file) as run:
        quad = run.vehicle
        quad.settle()
        for goal in _GOALS:
            stamp = quad.pose().stamp
            try:
                quad.goto(*goal, settle=True)
            except quadctl.Refused as refused:
                verdicts.append((stamp, goal, refused.reason))
                for _ in quad.watch("pose", _READ / _SPEED):
                    pass
            else:
                verdicts.append((stamp, goal, ""))
    return verdicts


def draw(file: Path, recording: Path, verdicts: list[tuple[float, Goal, str]]) -> None:
    """Draw the vehicle on its way as an animated picture."""
    pose = quadctl.read(recording)["pose"]
    stamp, position = pose["stamp"], pose["position"]
    begin, end = verdicts[0][0] - 0.5, stamp[-1]
    times = np.arange(begin, min(end, stamp[-1] + _TAIL), 1 / _RATE)
    figure = plt.figure(figsize=(5.2, 4.0), dpi=90)
    axes: Any = figure.add_subplot(projection="3d")
    figure.subplots_adjust(0, 0, 1, 0.94)

    def frame(now: float) -> None:
        axes.clear()
        axes.set(xlim=(-7, 7), ylim=(-7, 7), zlim=(0, 6), xlabel="x, m", ylabel="y, m")
        axes.set_box_aspect((14, 14, 6))
        _draw_cage(axes)
        shown = position[(stamp <= now) & (stamp >= begin)]
        axes.plot(*shown.T, color="tab:blue", linewidth=1.2)
        axes.plot(*shown[-1:].T, "o", color="tab:blue", markersize=6)
        title = "take-off"
        for at, goal, reason in verdicts:
            if at <= now:
                colour = "tab:red" if reason else "tab:green"
                axes.plot(*([each] for each in goal), "x", color=colour, markersize=7)
                title = f"goto {' '.join(f'{each:g}' for each in goal)}: {'rejected' if reason else 'accepted'}"
        axes.set_title(title, fontsize=10, family="monospace")

    made = FuncAnimation(figure, frame, frames=list(times), interval=1000 / _FRAMES)
    made.save(file, writer=PillowWriter(fps=_FRAMES))
    plt.close(figure)


def _draw_cage(axes: Any) -> None:
    low, high = -_CAGE, _CAGE
    corners = [(low, low), (high, low), (high, high), (low, high), (low, low)]
    for z in (0.0, _CAGE):
        axes.plot(*zip(*((x, y, z) for x, y in corners), strict=True), color="0.5", linewidth=0.8)
    for x, y in corners[:4]:
        axes.plot((x, x), (y, y), (0.0, _CAGE), color="0.5", linewidth=0.8)


_BOXES = {
    "quadctl\ncommands": (1.6, 4.2), "console\na web page": (3.4, 4.2), "Python programs\nand tests": (5.2, 4.2),
    "hub\na Zenoh router": (3.4, 2.6),
    "dynamics\nthe vehicle": (0.7, 1.0), "pressure\nthe barometer": (2.5, 1.0),
    "safety\nthe monitor": (4.3, 1.0), "recorder\nan MCAP file": (6.1, 1.0),
    "supervisor\nquadctl up": (0.7, 2.6), "gate\ndoor and routers": (6.1, 2.6), "other\nmachines": (8.2, 2.6),
}  # fmt: skip
"""Centre of each box."""
_ARROWS = (
    ("quadctl\ncommands", "hub\na Zenoh router", "calls", "<->"),
    ("console\na web page", "hub\na Zenoh router", "", "<->"),
    ("Python programs\nand tests", "hub\na Zenoh router", "calls, topics", "<->"),
    ("dynamics\nthe vehicle", "hub\na Zenoh router", "pose", "<->"),
    ("pressure\nthe barometer", "hub\na Zenoh router", "readings", "<->"),
    ("safety\nthe monitor", "hub\na Zenoh router", "setpoints, state", "<->"),
    ("hub\na Zenoh router", "recorder\nan MCAP file", "all keys", "->"),
    ("supervisor\nquadctl up", "hub\na Zenoh router", "starts, pings", "<->"),
    ("gate\ndoor and routers", "hub\na Zenoh router", "by role", "<->"),
    ("other\nmachines", "gate\ndoor and routers", "TLS", "<->"),
)
"""From, to, text, head."""
_OPTIONAL = ("console", "recorder", "gate", "other", "Python")
"""Boxes that a plain `quadctl up` does not start."""


def draw_architecture(file: Path) -> None:
    """Draw the processes of a run and what passes between them."""
    # The same bytes each time, and text as text.
    plt.rcParams |= {"svg.hashsalt": "quadctl", "svg.fonttype": "none"}
    figure, axes = plt.subplots(figsize=(9.2, 4.6))
    axes.set(xlim=(-0.3, 9.1), ylim=(0.5, 4.7))
    axes.axis("off")
    for begin, end, text, head in _ARROWS:
        at, to = _BOXES[begin], _BOXES[end]
        arrow = {"arrowstyle": head, "color": "0.45", "shrinkA": 24, "shrinkB": 24}
        axes.annotate("", to, at, arrowprops=arrow)
        middle = (0.62 * at[0] + 0.38 * to[0], 0.62 * at[1] + 0.38 * to[1])
        label = {"facecolor": "white", "edgecolor": "none", "pad": 1}
        axes.text(*middle, text, ha="center", va="center", fontsize=8, color="0.3", bbox=label)
    for text, centre in _BOXES.items():
        style = "--" if text.startswith(_OPTIONAL) else "-"
        box = {
            "boxstyle": "round,pad=0.5",
            "facecolor": "#eef2ff",
            "edgecolor": "#3b4fb8",
            "linestyle": style,
        }
        axes.text(*centre, text, ha="center", va="center", fontsize=9, bbox=box)
    figure.savefig(file, bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)


def draw_flight(file: Path) -> None:
    """Fly to the goals, and draw the flight."""
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder, "flight.mcap")
        draw(file, recording, flown(recording))


PICTURES: dict[str, Callable[[], object]] = {
    "architecture": lambda: draw_architecture(_DOCS / "explanation" / "architecture.svg"),
    "console": lambda: screens.draw_console(_DOCS / "console.png", _DOCS / "console-phone.png"),
    "flight": lambda: draw_flight(_DOCS / "flight.gif"),
    "report": lambda: screens.draw_report(_DOCS / "campaign-report.png"),
    "swap": lambda: (_DOCS / "swap.svg").write_text(swap.picture(*swap.flown()), "utf-8"),
}
"""Function that draws the files of each name."""


def main() -> None:
    """Draw the named pictures, or all."""
    parser = argparse.ArgumentParser(description="Draw the pictures of README and the book.")
    parser.add_argument("names", nargs="*", choices=PICTURES)
    for name in parser.parse_args().names or PICTURES:
        PICTURES[name]()


if __name__ == "__main__":
    main()
