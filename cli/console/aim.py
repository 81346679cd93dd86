"""Where a page's user aims at: by a click on the floor, or by keys in steps of a metre. Pure."""

from cli.console.board import Board
from schemas.messages import Position

STEPS = {
    "ArrowRight": (1, 0, 0),
    "ArrowLeft": (-1, 0, 0),
    "ArrowUp": (0, 1, 0),
    "ArrowDown": (0, -1, 0),
    "PageUp": (0, 0, 1),
    "PageDown": (0, 0, -1),
}
"""By the key's name in a browser: metres east, north and up."""


def clicked(x: float, y: float, height: float) -> Position:
    """The goal of a click on the floor: to 10 cm, which is finer than anybody points."""
    return Position(round(x, 1) + 0.0, round(y, 1) + 0.0, height)


def stepped(board: Board, target: Position | None, key: str) -> Position | None:
    """The target a step further: of the one there is, else of the vehicle's goal or place.

    None where nothing is known of either.
    """
    if target is None and board.state is not None:
        target = board.state.goal
    if target is None and board.pose is not None:
        target = board.pose.position
    if target is None:
        return None
    dx, dy, dz = STEPS[key]
    whole = (round(target.x + dx, 2), round(target.y + dy, 2), round(target.z + dz, 2))
    return Position(*(part + 0.0 for part in whole))
