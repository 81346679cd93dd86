"""Rule table of the automaton: every rule has its effect, and no other table passes."""

import itertools
import re
from collections import deque
from collections.abc import Iterator
from itertools import product
from math import inf
from typing import Any, NamedTuple

import pytest
from msgspec.structs import astuple, replace

from docs.diagram import diagram, table, words
from quadctl.schemas.messages import CageSize, Position, Velocity
from quadctl.schemas.params import CageParams
from quadctl.services.airspace.cage import why_outside
from quadctl.services.safety import automaton
from quadctl.services.safety.automaton import RULES, Rule, keep, step
from quadctl.services.safety.model import (
    Booted,
    Check,
    Event,
    FlightPhase,
    Gone,
    Goto,
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
from quadctl.services.safety.motion import verify
from tests.support.rule_cases import AT, CASES, Case
from tests.support.worlds import LAST, PARAMS, PLAIN, POSE, SEEING

CAGES = (CageSize(5.0, 5.0, 2.0), CageSize(3.0, 3.0, 2.0))
POINTS = ((0.0, 0.0, 1.0), (4.0, 0.0, 1.0), (9.0, 0.0, 1.0))
SPEEDS = (Velocity(0.0, 0.0, 0.0), Velocity(5.0, 0.0, 0.0), Velocity(-5.0, 0.0, 0.0))
ORIGIN = (0.0, 0.0, 0.0)
EXPLORED: tuple[Event, ...] = (
    *(Goto(point, *flags) for point in POINTS for flags in ((False, False), (True, False), (False, True))),
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


def checks(s: Situation, w: World) -> tuple[Event, ...]:
    """Return the verdict on the candidate, straight and by a corner; without one, on any goal."""
    verdict = verify(s, s.candidate or Goto(ORIGIN), w)
    route = verdict.route._replace(points=(POINTS[0], *verdict.route.points))
    return Check(verdict), Check(replace(verdict, route=route))


class Node(NamedTuple):
    """Situation in a cage, without fields that no rule reads: request count, reason."""

    situation: Situation
    cage: CageSize


def worlds(cage: CageSize, *, any_past: bool) -> tuple[World, ...]:
    """Return worlds with each place and speed, and one stale or with a jump.

    With `any_past`, each has every previous speed too.
    """
    seen = []
    params = replace(PARAMS, virtual_cage=CageParams(*astuple(cage)))
    for place, speed, before in product(POINTS, SPEEDS, SPEEDS):
        if any_past or speed is before:
            pose = replace(POSE, position=Position(*place), velocity=speed)
            last = replace(LAST, position=Position(*place), velocity=before)
            seen.append(replace(SEEING, pose=pose, last=last, params=params))
    leap = replace(seen[0], last=replace(LAST, position=Position(*POINTS[1])))
    return (*seen, leap if any_past else replace(leap, fresh=False))


WORLDS = {(cage, past): worlds(cage, any_past=past) for cage in CAGES for past in (True, False)}


def plain(situation: Situation) -> Situation:
    """Return the situation without the fields that no rule reads before they are set again."""
    changes: dict[str, Any] = {"request": 0, "reason": "", "boot": ""}
    # The motion so far counts among zones alone.
    changes |= {"origin": ORIGIN, "reach": None}
    # All worlds have one time: the command was given long before.
    changes["commanded"] = -inf
    if situation.candidate:
        changes["candidate"] = replace(situation.candidate, replace=False)
    # Only for hovering, where rules merely compare it: else ten times as many situations.
    if not situation.flies:
        changes["beyond"] = 0.0
    return replace(situation, **changes)


def out_of_control(before: Situation, world: World) -> bool:
    """Return whether the vehicle will stop farther outside than allowed without slowing down.

    All places lie along x, so this needs none of the automaton's own arithmetic.
    """
    x, v = world.pose.position.x, world.pose.velocity.x
    stop = x + v * abs(v) / 20.0
    out = max(stop - world.cage.x, -world.cage.x - stop, 0.0)
    outwards = v if stop > 0 else -v
    outwards_before = world.last.velocity.x if stop > 0 else -world.last.velocity.x
    return out > before.beyond + 0.01 and 0 < outwards >= outwards_before


class Explorer:
    """Explorer that applies every event to every situation, also between request and verdict."""

    def __init__(self) -> None:
        self.fired: set[Rule] = set()
        self.nodes: set[Node] = set()
        self.uncontrolled: list[tuple[Node, World]] = []
        self.controlled = 0
        start = Situation(ORIGIN, cage_on=True)
        self._waiting = deque([Node(start, CAGES[0])])
        while self._waiting:
            self._visit(self._waiting.popleft())

    def _visit(self, node: Node) -> None:
        if node in self.nodes:
            return
        self.nodes.add(node)
        situation = node.situation
        for cage, event in product(CAGES, EXPLORED):
            if cage == node.cage or isinstance(event, Resized):
                for world in WORLDS[cage, isinstance(event, Seen)]:
                    self._step(Node(situation, cage), event, world)
        for world in WORLDS[node.cage, False]:
            for event in checks(situation, world):
                self._step(node, event, world)

    def _step(self, node: Node, event: Event, world: World) -> None:
        situation, cage = node
        after = step(situation, event, world, on_rule=self.fired.add)
        if isinstance(event, Seen) and out_of_control(situation, world):
            astray = after.state is State.MOVING and after.cage_on
            self.uncontrolled += [(Node(situation, cage), world)] if astray else []
            self.controlled += situation.state is State.MOVING
        self._waiting.append(Node(plain(after), cage))


@pytest.fixture(scope="module")
def explorer() -> Explorer:
    return Explorer()


@pytest.mark.thorough
def test_never_moving_with_the_cage_on_and_the_goal_outside(explorer: Explorer):
    moving = [node for node in explorer.nodes if node.situation.state is State.MOVING]
    astray = [n for n in moving if n.situation.cage_on and why_outside(n.situation.goal, n.cage)]
    assert astray == []
    # With the cage off such goals are flown to: the check above is not vacuous.
    assert any(why_outside(node.situation.goal, node.cage) for node in moving)


@pytest.mark.thorough
def test_never_moving_with_the_cage_on_and_the_path_outside(explorer: Explorer):
    assert explorer.uncontrolled == []
    assert explorer.controlled > 100


@pytest.mark.thorough
def test_only_a_pause_has_a_flight_to_resume(explorer: Explorer):
    for situation, _ in explorer.nodes:
        assert (situation.paused is not None) is (situation.phase is FlightPhase.PAUSED)
        assert situation.candidate is None or situation.phase is not FlightPhase.PAUSED


@pytest.mark.thorough
def test_all_states_are_explored_and_every_rule_fires(explorer: Explorer):
    silent = set(RULES) - explorer.fired
    assert silent == set(), f"never fired: {[*map(str, silent)]}"
    states = dict.fromkeys(State, 0)
    for situation, _ in explorer.nodes:
        states[situation.state] += 1
    assert states == {State.HOVERING: 145, State.VERIFYING: 2094, State.MOVING: 320}


def test_every_transition_is_drawn_and_explained():
    arrows = {(rule.at.name, rule.to.name) for rule in RULES if rule.at is not rule.to}
    assert set(re.findall(r"<title>(\w+) to (\w+): ", diagram())) == arrows
    assert len(table().splitlines()) == sum(rule.do is not keep for rule in RULES) + 2
    explained = dict(line.removeprefix("- ").split(": ", 1) for line in words().splitlines())
    assert all(explained.values())
    named = {part.__name__ for rule in RULES for part in (rule.on, rule.when, rule.do)}
    assert set(explained) == {f"`{name}`" for name in named}


Table = tuple[Rule, ...]

EVENTS = tuple(dict.fromkeys(type(case.event) for case in CASES))
SAMPLE: dict[type[Event], Event] = {type(case.event): case.event for case in CASES}
CONDITIONS = tuple(dict.fromkeys(rule.when for rule in RULES))
ACTIONS = tuple(dict.fromkeys(rule.do for rule in RULES))


def name(rule: Rule) -> tuple[State, type[Event], str]:
    return rule.at, rule.on, rule.when.__name__


def label(case: Case) -> str:
    return f"{case.at.name} {type(case.event).__name__} {case.when}"


def fired_by(case: Case) -> list[Rule]:
    """Return the rules whose action was executed, as recorded by the action."""
    taken: list[Rule] = []

    def recording(rule: Rule) -> Rule:
        def do(situation: Situation, event: Event, world: World) -> Situation:
            taken.append(rule)
            return rule.do(situation, event, world)

        return rule._replace(do=do)

    step(case.situation, case.event, case.world, tuple(map(recording, RULES)))
    return taken


def judged(situation: Situation) -> Situation:
    """Return the situation without the present motion, which tests of ways cover."""
    return replace(situation, origin=PLAIN.origin, reach=None, commanded=PLAIN.commanded)


@pytest.mark.parametrize("case", CASES, ids=[f"{n} {label(c)}" for n, c in enumerate(CASES)])
def test_each_rule_does_what_its_case_expects(case: Case):
    assert judged(step(case.situation, case.event, case.world)) == case.expected
    assert [name(rule) for rule in fired_by(case)] == [case.rule]


COMMANDS = (
    automaton.take, automaton.turn, automaton.resume, automaton.pause, automaton.stop,
    automaton.stop_pose_jump, automaton.toggle_and_stop, automaton.resize_and_stop,
)  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=[f"{n} {label(c)}" for n, c in enumerate(CASES)])
def test_a_situation_knows_when_the_vehicle_was_commanded(case: Case):
    before = replace(case.situation, commanded=0.25)
    after = step(before, case.event, case.world)
    (rule,) = fired_by(case)
    same_goal = rule.do is automaton.turn and after.goal == before.goal
    commands = rule.do in COMMANDS and not same_goal
    rebooted = -inf if rule.do is automaton.reboot else before.commanded
    assert after.commanded == (case.world.pose.stamp if commands else rebooted)


def test_every_rule_has_a_case_and_a_unique_name():
    names = [name(rule) for rule in RULES]
    assert len(set(names)) == len(names)
    assert set(names) == {case.rule for case in CASES}


def test_every_event_condition_and_action_is_used():
    assert set(EVENTS) == set(Event.__args__)
    own = {
        thing
        for thing in vars(automaton).values()
        if callable(thing) and getattr(thing, "__module__", "") == automaton.__name__
        if not thing.__name__.startswith("_")
    }
    assert own - {Rule, automaton.by_place, step} == {*CONDITIONS, *ACTIONS}


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("event", EVENTS, ids=lambda event: event.__name__)
def test_every_state_and_event_has_a_default_rule(state: State, event: type[Event]):
    rules = [rule for rule in RULES if rule.at is state and rule.on is event]
    assert [rule for rule in rules if rule.when is automaton.always] == rules[-1:]
    step(replace(PLAIN, **AT[state]), SAMPLE[event], SEEING)


def test_without_a_matching_rule_an_error_is_raised():
    with pytest.raises(LookupError, match="no rule"):
        step(PLAIN, SAMPLE[EVENTS[0]], SEEING, ())


def holds(table: Table) -> bool:
    """Return whether a table passes every case without an error."""
    try:
        return all(judged(step(c.situation, c.event, c.world, table)) == c.expected for c in CASES)
    except (LookupError, AssertionError):
        return False


def replaced(number: int, **change: Any) -> Table:
    return (*RULES[:number], RULES[number]._replace(**change), *RULES[number + 1 :])


def mutants() -> Iterator[tuple[str, Table]]:
    """Yield every table that differs from RULES by one effective change.

    Swaps of two rules of different states or events are left out: they change nothing.
    Rules of one state and event are adjacent, so swaps of neighbours are all swaps.
    """
    for number, rule in enumerate(RULES):
        yield f"{name(rule)} deleted", (*RULES[:number], *RULES[number + 1 :])
        choices: dict[str, tuple[object, ...]] = {
            "at": tuple(State),
            "on": EVENTS,
            "when": CONDITIONS,
            "to": tuple(State),
            "do": ACTIONS,
        }
        for field, values in choices.items():
            for value in values:
                if value is not getattr(rule, field):
                    yield f"{name(rule)} {field}={value}", replaced(number, **{field: value})
    for number, (rule, after) in enumerate(itertools.pairwise(RULES)):
        if (rule.at, rule.on) == (after.at, after.on):
            swapped = (*RULES[:number], after, rule, *RULES[number + 2 :])
            yield f"{name(rule)} swapped with {name(after)}", swapped


EQUAL = {
    f"{name(rule)} do={automaton.resize_and_stop}"
    for rule in RULES
    if rule.on is Seen and rule.when is automaton.straying
}
"""Mutants that change nothing: a guard's stop sets `beyond` after the resize did."""


@pytest.mark.thorough
def test_no_mutant_of_the_rule_table_passes_all_cases():
    found = list(mutants())
    kinds = len(State) - 1 + len(EVENTS) - 1 + len(CONDITIONS) - 1 + len(State) - 1
    swaps = len(RULES) - len({(rule.at, rule.on) for rule in RULES})
    assert len(found) == len(RULES) * (1 + kinds + len(ACTIONS) - 1) + swaps
    assert len(found) > 60
    assert holds(RULES)
    assert {what for what, table in found if holds(table)} == EQUAL
