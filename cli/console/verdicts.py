"""What a change of safety's state tells, in words: the log of verdicts. Pure."""

from collections.abc import Iterator
from typing import NamedTuple

from schemas.messages import CageSize, Position, SafetyState


class Verdict(NamedTuple):
    """A line of the log: at a simulated time (s), of a kind that says how it is drawn."""

    stamp: float
    kind: str
    text: str


def point(at: Position) -> str:
    """A place as people write it, m."""
    return f"({_metres(at.x)}, {_metres(at.y)}, {_metres(at.z)})"


def told(before: SafetyState | None, now: SafetyState) -> Iterator[tuple[str, str]]:
    """The kind and text of each thing that happened from one state to the next."""
    if before is None:
        return
    if now.boot != before.boot:
        yield "boot", now.reason or "the simulation began anew"
        return
    if now.cage_on != before.cage_on:
        yield "cage", f"cage {'on' if now.cage_on else 'off'}"
    if now.cage != before.cage:
        yield "cage", f"cage is now {bounds(now.cage)}"
    if now.state == "VERIFYING":
        return
    if now.request > before.request or before.state == "VERIFYING":
        yield ("refused", now.reason) if now.reason else ("accepted", f"to {point(now.goal)}")
    elif before.state == "MOVING" and now.state == "HOVERING" and not now.reason:
        yield "arrived", f"at {point(now.goal)}"
    elif now.reason and (now.reason != before.reason or now.state != before.state):
        yield "stopped" if now.state == "HOVERING" else "went on", now.reason


def bounds(cage: CageSize) -> str:
    """The cage's three intervals, m."""
    return f"x [-{cage.x:g}, {cage.x:g}], y [-{cage.y:g}, {cage.y:g}], z [0, {cage.z:g}]"


def _metres(value: float) -> str:
    # Two digits, without the minus of a negative nought.
    return f"{round(value, 2) + 0.0:g}"
