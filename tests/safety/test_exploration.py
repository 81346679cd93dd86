"""Every situation that the automaton can be brought into on a coarse grid, and what never is."""

from collections import deque
from itertools import product
from typing import NamedTuple

import pytest
from msgspec.structs import replace

from schemas.geometry import Position, Velocity
from schemas.messages import CageSize
from services.safety.cage import why_outside
from services.safety.fsa import RULES, Rule, step
from services.safety.model import (
    Ask,
    Booted,
    Check,
    Event,
    Hold,
    Lost,
    Resized,
    Seen,
    Situation,
    State,
    Toggle,
    World,
)
from tests.safety.rows import POSE

CAGES = (CageSize(5.0, 5.0, 2.0), CageSize(3.0, 3.0, 2.0))
POINTS = (Position(0.0, 0.0, 1.0), Position(4.0, 0.0, 1.0), Position(9.0, 0.0, 1.0))
SPEEDS = (Velocity(0.0, 0.0, 0.0), Velocity(1.0, 0.0, 0.0))
NOBODY = Ask(Position(0.0, 0.0, 0.0))
EVENTS: tuple[Event, ...] = (
    *(Ask(point, *flags) for point in POINTS for flags in ((False, False), (True, False), (False, True))),
    Seen(),
    Lost(0.2),
    Booted("anew"),
    Hold(),
    Toggle(cage_on=True),
    Toggle(cage_on=False),
    Resized(),
)  # fmt: skip


class Node(NamedTuple):
    """A situation in a cage; who asked how often makes no difference."""

    situation: Situation
    cage: CageSize


def worlds(cage: CageSize) -> tuple[World, ...]:
    seen = tuple(
        World(replace(POSE, position=place, velocity=speed), True, cage, acceptance_range=0.5)
        for place, speed in product(POINTS, SPEEDS)
    )
    return (*seen, World(POSE, False, cage, acceptance_range=0.5))


WORLDS = {cage: worlds(cage) for cage in CAGES}


def plain(situation: Situation) -> Situation:
    candidate = situation.candidate if situation.state is State.VERIFYING else NOBODY
    return replace(situation, request=0, candidate=candidate)


class Explorer:
    """Feeds the table every event at every situation, between request and verdict as well."""

    def __init__(self) -> None:
        self.fired: set[int] = set()
        self._rules = tuple(self._telling(number, rule) for number, rule in enumerate(RULES))
        self.nodes: set[Node] = set()
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
        for cage in CAGES:
            for event, world in product((*EVENTS, Check()), WORLDS[cage]):
                if cage != node.cage and not isinstance(event, Resized):
                    continue
                after = step(node.situation, event, world, self._rules)
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
    assert states == {State.HOVERING: 932, State.VERIFYING: 1944, State.MOVING: 240}
