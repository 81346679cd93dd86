"""What a page is sent ten times a second: the newest values, and what came since it was last seen."""

import math
from typing import Any

from cli.console.board import Board, Sample
from cli.console.verdicts import bounds, point
from schemas.messages import Pose, Position

_SILENT = 1.0
"""Seconds without a pose after which the page says so."""

NOTHING_SEEN = (-1, 0)
"""What a page that is just opened has seen: no boot, no sample."""


def frame(board: Board, seen: tuple[int, int], target: Position | None) -> dict[str, Any]:
    """The picture for a page that has seen samples of an epoch up to a number.

    `target` is where its user aims at.
    """
    epoch, number = seen if seen[0] == board.epoch else (board.epoch, 0)
    new = [sample for sample in board.samples if sample.number > number]
    state, pose = board.state, board.pose
    return {
        "epoch": epoch,
        "fresh": number == 0,
        "seen": new[-1].number if new else number,
        "link": link(board),
        "state": state.state if state else "",
        "verified": board.verified,
        "cage": [state.cage.x, state.cage.y, state.cage.z] if state else None,
        "cage_on": bool(state and state.cage_on),
        "goal": _xyz(state.goal) if state else None,
        "pose": [*_xyz(pose.position), *_turn(pose)] if pose else None,
        "target": _xyz(target) if target else None,
        "refused": [_xyz(goal) for goal in board.refused],
        "samples": [_sample(sample) for sample in new],
        "read": readouts(board, target),
    }


def link(board: Board) -> str:
    """How it stands with the run: `live`, `silent` (no poses come) or `lost`."""
    if board.problem:
        return "lost"
    return "silent" if board.silence > _SILENT or board.pose is None else "live"


def readouts(board: Board, target: Position | None) -> dict[str, str]:
    """Every text on the page that changes with the vehicle."""
    state, pose, reading = board.state, board.pose, board.reading
    said = {"link": _LINKS[link(board)], "problem": board.problem}
    if link(board) == "silent":
        said["problem"] = "no pose comes: dynamics is down or frozen"
    if pose is not None:
        v = pose.velocity
        said |= {axis: f"{getattr(pose.position, axis) + 0.0:.2f}" for axis in "xyz"}
        said["speed"] = f"{math.hypot(v.x, v.y, v.z):.2f} m/s"
        said["time"] = f"{pose.stamp:.1f} s"
        said["height"] = f"{pose.position.z:.2f} m"
    if state is not None:
        said |= {"state": state.state, "reason": state.reason, "goal": point(state.goal)}
        said["cage"] = bounds(state.cage)
    if reading is not None:
        said["pressure"] = f"{reading.pressure:.5g} hPa" if reading.baseline else (
            f"{reading.pressure:.4f} hPa"
        )  # fmt: skip
        said["baseline"] = f"{reading.baseline:.4f} hPa" if reading.baseline else "not calibrated"
    said["target"] = f"{point(target)}: Enter sends" if target else ""
    return said


_LINKS = {"live": "live", "silent": "no pose", "lost": "not connected"}


def _sample(s: Sample) -> list[float | None]:
    return [round(s.stamp, 3), _fine(s.x), _fine(s.y), _fine(s.z), s.pressure, s.baseline]


def _xyz(at: Position) -> list[float]:
    return [_fine(at.x), _fine(at.y), _fine(at.z)]


def _fine(part: float) -> float:
    """To a tenth of a millimetre: a hovering vehicle looks still, and is not drawn again."""
    return round(part, 4)


def _turn(pose: Pose) -> list[float]:
    """As three.js wants a quaternion: x, y, z, w."""
    q = pose.orientation
    return [_fine(q.x), _fine(q.y), _fine(q.z), _fine(q.w)]
