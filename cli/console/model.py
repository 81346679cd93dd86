"""The state of a console page and the frames sent to it. Pure."""

import math
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple, get_args

from quadctl.schemas.messages import (
    CageSize,
    NearestWall,
    Pose,
    Position,
    Pressure,
    SafetyState,
    StateName,
    Zone,
)
from quadctl.schemas.params import in_lockstep
from quadctl.schemas.zones import FARTHEST
from quadctl.services.runtime.run_files import ProcessRecord
from quadctl.services.runtime.terminal import escaped


class Verdict(NamedTuple):
    """Line of the log: simulated time (s), kind (its CSS class) and text."""

    stamp: float
    kind: str
    text: str


def point(at: Position) -> str:
    """Return a place as text, m."""
    return f"({_metres(at.x)}, {_metres(at.y)}, {_metres(at.z)})"


def events_between(before: SafetyState | None, now: SafetyState) -> Iterator[tuple[str, str]]:
    """Yield the kind and text of each event between two states."""
    if before is None:
        return
    if now.boot != before.boot:
        yield "boot", now.reason or "the simulation restarted"
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
    """Return the cage's three intervals as text, m."""
    return f"x [-{cage.x:g}, {cage.x:g}], y [-{cage.y:g}, {cage.y:g}], z [0, {cage.z:g}]"


def _metres(value: float) -> str:
    # Adding 0.0 turns -0 into 0.
    return f"{round(value, 2) + 0.0:g}"


TICK = 0.1
"""Seconds between two samples, and between two frames sent to a page."""
_KEPT = 600
_REFUSED_KEPT = 8
_VERDICTS_KEPT = 60


class Sample(NamedTuple):
    """Point of trail and plots: simulated s, m, hPa; `pressure` is None without a new reading."""

    number: int
    stamp: float
    x: float
    y: float
    z: float
    pressure: float | None
    baseline: float


class Glance(NamedTuple):
    """Snapshot for the slower panels of a page; `noted` counts all lines ever logged."""

    state: SafetyState | None
    nodes: tuple[ProcessRecord, ...]
    values: dict[str, Any]
    verdicts: tuple[Verdict, ...]
    noted: int


class Board:
    """State of a page; `epoch` counts the simulation's boots seen, each of which clears samples.

    `zoned` counts the changes of the zones, `moved` those of the other vehicles' goals.
    """

    def __init__(self, vehicle: str) -> None:
        self.vehicle = vehicle
        self.problem = ""
        self.pose: Pose | None = None
        self.state: SafetyState | None = None
        self.reading: Pressure | None = None
        self.samples: deque[Sample] = deque(maxlen=_KEPT)
        self.refused: deque[Position] = deque(maxlen=_REFUSED_KEPT)
        self.verdicts: deque[Verdict] = deque(maxlen=_VERDICTS_KEPT)
        self.zones: tuple[Zone, ...] = ()
        self.others: tuple[Position, ...] = ()
        """Where each other vehicle holds or flies to, m."""
        self.verified, self.noted, self.epoch, self.zoned, self.moved = 0, 0, 0, 0, 0
        self.silence = 0.0
        self.nodes: list[ProcessRecord] = []
        self.values: dict[str, Any] = {}
        self._number = 0
        self._requested: Position | None = None

    def update_state(self, now: SafetyState) -> None:
        """Take the automaton's state and log its events."""
        if now.state == "VERIFYING":
            self.verified += 1
        for kind, text in events_between(self.state, now):
            self.note(now.stamp, kind, text)
            if kind == "refused" and self._requested is not None:
                self.refuse(self._requested)
            if kind in {"accepted", "refused"}:
                self._requested = None
        if self.state is not None and now.boot != self.state.boot:
            self.refused.clear()
        self.state = now

    def update_zones(self, now: tuple[Zone, ...]) -> None:
        """Take the zones in force while the cage is on."""
        if now != self.zones:
            self.zones = now
            self.zoned += 1

    def update_others(self, now: tuple[Position, ...]) -> None:
        """Take the goals of the other vehicles."""
        if now != self.others:
            self.others = now
            self.moved += 1

    def add_request(self, goal: Position) -> None:
        """Take a waypoint from the topic; a later state carries its verdict."""
        self._requested = goal

    def refuse(self, goal: Position) -> None:
        """Mark a goal that safety refused."""
        if goal in self.refused:
            self.refused.remove(goal)
        self.refused.append(goal)

    def note(self, stamp: float, kind: str, text: str) -> None:
        """Log a line at a simulated time (s)."""
        self.noted += 1
        self.verdicts.appendleft(Verdict(stamp, kind, text))

    def tick(self, pose: Pose | None, reading: Pressure | None) -> None:
        """Take the newest pose and reading of the last tenth of a second, None for none."""
        self.silence = 0.0 if pose is not None else self.silence + TICK
        if reading is not None:
            self.reading = reading
        if pose is None:
            return
        if self.pose is not None and pose.boot != self.pose.boot:
            self.samples.clear()
            self.epoch += 1
        self.pose, at = pose, pose.position
        self._number += 1
        self.samples.append(
            Sample(
                self._number, pose.stamp, at.x, at.y, at.z,
                None if reading is None else reading.pressure,
                self.reading.baseline if self.reading else 0.0,
            )
        )  # fmt: skip

    def glance(self) -> Glance:
        """Return a copy, which does not change."""
        verdicts = tuple(self.verdicts)
        return Glance(self.state, tuple(self.nodes), dict(self.values), verdicts, self.noted)


STEPS = {
    "ArrowRight": (1, 0, 0),
    "ArrowLeft": (-1, 0, 0),
    "ArrowUp": (0, 1, 0),
    "ArrowDown": (0, -1, 0),
    "PageUp": (0, 0, 1),
    "PageDown": (0, 0, -1),
}
"""Metres east, north and up, by the key's name in a browser."""


def clicked(x: float, y: float, height: float) -> Position:
    """Return the goal of a click on the floor, rounded to 10 cm, finer than a user can point."""
    return Position(round(x, 1) + 0.0, round(y, 1) + 0.0, height)


def stepped(board: Board, target: Position | None, key: str) -> Position | None:
    """Return the target, else the vehicle's goal, else its place, moved a step; None if unknown."""
    if target is None and board.state is not None:
        target = board.state.goal
    if target is None and board.pose is not None:
        target = board.pose.position
    if target is None:
        return None
    dx, dy, dz = STEPS[key]
    whole = (round(target.x + dx, 2), round(target.y + dy, 2), round(target.z + dz, 2))
    return Position(*(part + 0.0 for part in whole))


STATES: tuple[str, ...] = get_args(StateName)

WAYS = {
    ("HOVERING", "VERIFYING"): "asked",
    ("VERIFYING", "MOVING"): "permitted",
    ("VERIFYING", "HOVERING"): "refused",
    ("MOVING", "VERIFYING"): "changed",
    ("HOVERING", "MOVING"): "went on",
    ("MOVING", "HOVERING"): "arrived, stopped, paused",
}
"""Label of each transition between two states in safety's table."""

_W, _H, _GAP, _TOP = 92, 34, 36, 44


def drawing() -> str:
    """Return an SVG; the page lights the current state by its class, e.g. `state-MOVING`."""
    width = len(STATES) * _W + (len(STATES) - 1) * _GAP + 2
    parts = [_way(*pair, text) for pair, text in WAYS.items()] + [_box(name) for name in STATES]
    return (
        f'<svg class="automaton" viewBox="0 0 {width} 118" role="img"'
        f' aria-label="The automaton: {", ".join(STATES)}">'
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6"'
        ' markerHeight="6" orient="auto"><path d="M0 0 8 4 0 8z"/></marker></defs>'
        f"{''.join(parts)}</svg>"
    )


def _left(state: str) -> int:
    return 1 + STATES.index(state) * (_W + _GAP)


def _box(state: str) -> str:
    x = _left(state)
    return (
        f'<g class="state state-{state}"><rect x="{x}" y="{_TOP}" width="{_W}" height="{_H}"'
        f' rx="17"/><text x="{x + _W / 2:g}" y="{_TOP + 21}">{state}</text></g>'
    )


def _way(start: str, end: str, text: str) -> str:
    """Draw an arrow: forwards above the middle, backwards below it, around a skipped state."""
    step = STATES.index(end) - STATES.index(start)
    if abs(step) == 1:
        y = _TOP + _H / 2 + (-6 if step > 0 else 6)
        x1 = _left(start) + (_W if step > 0 else 0)
        x2 = _left(end) + (0 if step > 0 else _W)
        line = f"M{x1} {y:g}H{x2}"
        words = (x1 + x2) / 2, (_TOP - 5 if step > 0 else _TOP + _H + 12)
        anchor = f'<text x="{words[0]:g}" y="{words[1]}">{text}</text>'
    elif step > 0:
        x1, x2 = _left(start) + _W // 2, _left(end) + _W // 2
        top = _TOP - 24
        line = f"M{x1:g} {_TOP}V{top + 8}q0 -8 8 -8H{x2 - 8:g}q8 0 8 8V{_TOP - 1}"
        anchor = f'<text x="{(x1 + x2) / 2:g}" y="{top - 5}">{text}</text>'
    else:
        x1, x2 = _left(start) + _W // 2, _left(end) + _W // 2
        y, bottom = _TOP + _H, _TOP + _H + 24
        line = f"M{x1:g} {y}V{bottom - 8}q0 8 -8 8H{x2 + 8:g}q-8 0 -8 -8V{y + 1}"
        anchor = f'<text x="{(x1 + x2) / 2:g}" y="{bottom + 12}">{text}</text>'
    return f'<g class="way"><path d="{line}" marker-end="url(#tip)"/>{anchor}</g>'


_SILENT = 1.0  # s without a pose after which the page reports silence


class Sent(NamedTuple):
    """Newest epoch, sample, and changes of the zones and of the others that a page has."""

    epoch: int
    sample: int
    zoned: int
    moved: int


NOTHING_SEEN = Sent(-1, 0, -1, -1)


def frame(board: Board, seen: Sent, target: Position | None) -> tuple[dict[str, Any], Sent]:
    """Return the frame for a page, and what the page has seen with it.

    The page's user aims at the `target`. Zones and other vehicles that it has are not sent again: there may
    be thousands of corners.
    """
    number = seen.sample if seen.epoch == board.epoch else 0
    new = [sample for sample in board.samples if sample.number > number]
    after = Sent(board.epoch, new[-1].number if new else number, board.zoned, board.moved)
    state, pose = board.state, board.pose
    content = {
        "fresh": number == 0,
        "seen": after.sample,
        "link": link(board),
        "state": state.state if state else "",
        "verified": board.verified,
        "cage": [state.cage.x, state.cage.y, state.cage.z] if state else None,
        "cage_on": bool(state and state.cage_on),
        "zones": None if seen.zoned == board.zoned else [_column(zone) for zone in board.zones],
        "others": None if seen.moved == board.moved else [*map(_xyz, board.others)],
        "near": bool(state and state.nearest.near),
        "goal": _xyz(state.goal) if state else None,
        "pose": [*_xyz(pose.position), *_quaternion(pose)] if pose else None,
        "target": _xyz(target) if target else None,
        "refused": [_xyz(goal) for goal in board.refused],
        "samples": [_sample(sample) for sample in new],
        "read": readouts(board, target),
    }
    return content, after


def link(board: Board) -> str:
    """Return the state of the connection: `connecting`, `live`, `silent` (no poses) or `lost`."""
    if board.problem:
        return "lost"
    if board.silence > _SILENT:
        return "silent"
    return "live" if board.pose is not None else "connecting"


def readouts(board: Board, target: Position | None) -> dict[str, str]:
    """Return every text on the page that changes with the vehicle."""
    state, pose, reading = board.state, board.pose, board.reading
    texts = {"link": _LINKS[link(board)], "problem": board.problem}
    if link(board) == "silent":
        texts["problem"] = "no poses arrive: dynamics is down or frozen"
    if pose is not None:
        v = pose.velocity
        texts |= {axis: f"{getattr(pose.position, axis) + 0.0:.2f}" for axis in "xyz"}
        texts["speed"] = f"{math.hypot(v.x, v.y, v.z):.2f} m/s"
        how = " in lock-step" * in_lockstep(board.values)
        how += ", no promise holds" * bool(board.values.get("dynamics.unproven"))
        texts["time"] = f"{pose.stamp:.1f} s{how}"
        texts["height"] = f"{pose.position.z:.2f} m"
    if state is not None:
        texts |= {"state": state.state, "reason": state.reason, "goal": point(state.goal)}
        texts |= {"cage": bounds(state.cage), "nearest": _wall(state.nearest)}
        texts["leg"] = f"leg {state.leg} of {state.legs}" if state.legs else ""
    if reading is not None:
        texts["pressure"] = f"{reading.pressure:{'.5g' if reading.baseline else '.4f'}} hPa"
        texts["baseline"] = f"{reading.baseline:.4f} hPa" if reading.baseline else "not calibrated"
    texts["target"] = f"{point(target)}: Enter sends" if target else ""
    return {name: escaped(text) for name, text in texts.items()}


_LINKS = {"connecting": "connecting", "live": "live", "silent": "no pose", "lost": "not connected"}


def _wall(wall: NearestWall) -> str:
    return f"{wall.name}, {wall.distance + 0.0:.2f} m" if wall.name else "-"


def _column(zone: Zone) -> dict[str, Any]:
    """Return a zone to draw; a missing bound is None, and so is the circle of a polygon."""
    circle = zone.circle
    return {
        "name": escaped(zone.name),
        "kind": zone.kind,
        "corners": zone.polygon,
        "circle": None if zone.polygon else (circle.x, circle.y, circle.radius),
        "floor": None if zone.floor == -FARTHEST else zone.floor,
        "ceiling": None if zone.ceiling == FARTHEST else zone.ceiling,
    }


def _sample(s: Sample) -> list[float | None]:
    return [round(s.stamp, 3), _rounded(s.x), _rounded(s.y), _rounded(s.z), s.pressure, s.baseline]


def _xyz(at: Position) -> list[float]:
    return [_rounded(at.x), _rounded(at.y), _rounded(at.z)]


def _rounded(part: float) -> float:
    """Round to 0.1 mm: a hovering vehicle then looks still and is not redrawn."""
    return round(part, 4)


def _quaternion(pose: Pose) -> list[float]:
    """Return the quaternion in the order of three.js: x, y, z, w."""
    q = pose.orientation
    return [_rounded(q.x), _rounded(q.y), _rounded(q.z), _rounded(q.w)]
