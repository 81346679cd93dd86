"""Every situation that the automaton can be brought into on a coarse grid, and what never is."""

from collections import deque
from itertools import product
from typing import Any, NamedTuple

import pytest
from msgspec.structs import replace

from quadctl.schemas.messages import CageSize, Position, Velocity
from quadctl.services.safety.automaton import RULES, Rule, step
from quadctl.services.safety.cage import why_outside
from quadctl.services.safety.model import (
    Ask,
    Booted,
    Check,
    Event,
    Gone,
    Halted,
    Hold,
    Lagged,
    Lost,
    Resized,
    Seen,
    Situation,
    State,
    Toggle,
    World,
)
from tests.safety.worlds import ENVELOPE, LAST, POSE

CAGES = (CageSize(5.0, 5.0, 2.0), CageSize(3.0, 3.0, 2.0))
POINTS = (Position(0.0, 0.0, 1.0), Position(4.0, 0.0, 1.0), Position(9.0, 0.0, 1.0))
SPEEDS = (Velocity(0.0, 0.0, 0.0), Velocity(5.0, 0.0, 0.0), Velocity(-5.0, 0.0, 0.0))
NOBODY = Ask(Position(0.0, 0.0, 0.0))
EVENTS: tuple[Event, ...] = (
    *(Ask(point, *flags) for point in POINTS for flags in ((False, False), (True, False), (False, True))),
    Seen(),
    Lost(0.2),
    Gone("nothing"),
    Lagged("for a while"),
    Halted("alone"),
    Booted("anew"),
    Hold(),
    Toggle(cage_on=True),
    Toggle(cage_on=False),
    Resized(),
)  # fmt: skip


class Node(NamedTuple):
    """A situation in a cage; who asked how often, and what was said, makes no difference."""

    situation: Situation
    cage: CageSize


def worlds(cage: CageSize, *, any_past: bool) -> tuple[World, ...]:
    """Each place at each speed, and none seen; for what looks at the past, come to at any speed."""
    seen = []
    for place, speed, before in product(POINTS, SPEEDS, SPEEDS):
        if any_past or speed is before:
            pose = replace(POSE, position=place, velocity=speed)
            last = replace(LAST, position=place, velocity=before)
            seen.append(World(pose, last, True, cage, 0.5, ENVELOPE))
    leap = replace(seen[0], last=replace(LAST, position=POINTS[1]))
    return (*seen, leap if any_past else replace(leap, fresh=False))


WORLDS = {(cage, past): worlds(cage, any_past=past) for cage in CAGES for past in (True, False)}


def plain(situation: Situation) -> Situation:
    """Without what no rule looks at before it is written anew."""
    changes: dict[str, Any] = {"request": 0, "reason": "", "boot": "", "since": 0.0}
    if situation.state is State.VERIFYING:
        changes["candidate"] = replace(situation.candidate, replace=False)
    else:
        changes |= {"candidate": NOBODY, "back": State.HOVERING}
    # Of a hovering one alone, lest there be ten times as many: the rules compare it, no more.
    if State.MOVING not in {situation.state, situation.back}:
        changes["beyond"] = 0.0
    return replace(situation, **changes)


def out_of_control(before: Situation, world: World) -> bool:
    """Bound for a stop farther out of the cage than it has been let, and no slower than before.

    All places lie along x, so the ways are told without the automaton's own arithmetic.
    """
    x, v = world.pose.position.x, world.pose.velocity.x
    stop = x + v * abs(v) / 20.0
    out = max(stop - world.cage.x, -world.cage.x - stop, 0.0)
    outwards = v if stop > 0 else -v
    outwards_before = world.last.velocity.x if stop > 0 else -world.last.velocity.x
    return out > before.beyond + 0.01 and 0 < outwards >= outwards_before


class Explorer:
    """Feeds the table every event at every situation, between request and verdict as well."""

    def __init__(self) -> None:
        self.fired: set[int] = set()
        self._rules = tuple(self._telling(number, rule) for number, rule in enumerate(RULES))
        self.nodes: set[Node] = set()
        self.uncontrolled: list[tuple[Node, World]] = []
        self.controlled = 0
        start = Situation(State.HOVERING, NOBODY.goal, True, NOBODY)
        self._waiting = deque([Node(start, CAGES[0])])
        while self._waiting:
            self._visit(self._waiting.popleft())

    def _telling(self, number: int, rule: Rule) -> Rule:
        def do(situation: Situation, event: Event, world: World) -> Situation:
            self.fired.add(number)
            return rule.do(situation, event, world)

        return rule._replace(do=do)

    def _visit(self, node: Node) -> None:
        if node in self.nodes:
            return
        self.nodes.add(node)
        for cage, event in product(CAGES, (*EVENTS, Check())):
            if cage != node.cage and not isinstance(event, Resized):
                continue
            for world in WORLDS[cage, isinstance(event, Seen)]:
                after = step(node.situation, event, world, self._rules)
                if isinstance(event, Seen) and out_of_control(node.situation, world):
                    astray = after.state is State.MOVING and after.cage_on
                    self.uncontrolled += [(node, world)] if astray else []
                    self.controlled += node.situation.state is State.MOVING
                self._waiting.append(Node(plain(after), cage))


@pytest.fixture(scope="module")
def explorer() -> Explorer:
    return Explorer()


def test_never_moving_with_the_cage_on_and_the_goal_outside(explorer: Explorer):
    moving = [node for node in explorer.nodes if node.situation.state is State.MOVING]
    astray = [n for n in moving if n.situation.cage_on and why_outside(n.situation.goal, n.cage)]
    assert astray == []
    # With the cage off it does fly there: the line above is not true of an empty set.
    assert any(why_outside(node.situation.goal, node.cage) for node in moving)


def test_never_moving_with_the_cage_on_and_the_way_outside(explorer: Explorer):
    assert explorer.uncontrolled == []
    assert explorer.controlled > 100


def test_never_braking_while_moving_nor_flying_on_while_settling(explorer: Explorer):
    for situation, _ in explorer.nodes:
        if situation.state is State.MOVING:
            assert not situation.brake
            assert not situation.settling
        assert situation.brake or not situation.settling
        assert not situation.takeoff or situation.state is not State.HOVERING


def test_all_of_it_was_explored_and_every_row_fired(explorer: Explorer):
    assert explorer.fired == set(range(len(RULES)))
    states = dict.fromkeys(State, 0)
    for situation, _ in explorer.nodes:
        states[situation.state] += 1
    assert states == {State.HOVERING: 268, State.VERIFYING: 1401, State.MOVING: 206}
