"""The automaton's table: every row does what it says, and no other table would do."""

import itertools
from collections.abc import Iterator
from typing import Any

import pytest
from msgspec.structs import replace

from quadctl.services.safety import automaton
from quadctl.services.safety.automaton import RULES, Rule, step
from quadctl.services.safety.model import Event, Situation, State, World
from tests.safety.rows import CASES, Case
from tests.safety.worlds import PLAIN, SEEING

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
    """The rule whose action was taken, told by the action itself."""
    taken: list[Rule] = []

    def telling(rule: Rule) -> Rule:
        def do(situation: Situation, event: Event, world: World) -> Situation:
            taken.append(rule)
            return rule.do(situation, event, world)

        return rule._replace(do=do)

    step(case.situation, case.event, case.world, tuple(map(telling, RULES)))
    return taken


@pytest.mark.parametrize("case", CASES, ids=[f"{n} {label(c)}" for n, c in enumerate(CASES)])
def test_a_row_does_this(case: Case):
    assert step(case.situation, case.event, case.world) == case.expected
    assert [name(rule) for rule in fired_by(case)] == [case.rule]


def test_every_row_has_a_case_and_a_name_of_its_own():
    names = [name(rule) for rule in RULES]
    assert len(set(names)) == len(names)
    assert set(names) == {case.rule for case in CASES}


def test_every_event_and_every_condition_and_action_is_in_the_table():
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
def test_every_state_and_event_has_a_last_rule_that_always_fits(state: State, event: type[Event]):
    rules = [rule for rule in RULES if rule.at is state and rule.on is event]
    assert [rule for rule in rules if rule.when is automaton.always] == rules[-1:]
    step(replace(PLAIN, state=state), SAMPLE[event], SEEING)


def test_without_a_rule_it_says_so_instead_of_guessing():
    with pytest.raises(LookupError, match="no rule"):
        step(PLAIN, SAMPLE[EVENTS[0]], SEEING, ())


def holds(table: Table) -> bool:
    """Whether a table passes every case; one that fails in any way does not."""
    try:
        return all(step(c.situation, c.event, c.world, table) == c.expected for c in CASES)
    except (LookupError, AssertionError):
        return False


def replaced(number: int, **change: Any) -> Table:
    return (*RULES[:number], RULES[number]._replace(**change), *RULES[number + 1 :])


def mutants() -> Iterator[tuple[str, Table]]:
    """Every table one change away from RULES that is not the same automaton.

    Left out because they change nothing: the swap of two rows of different states or events.
    Rows of one state and event stand together, so their neighbours are all the swaps there are.
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


def test_no_mutant_of_the_table_survives():
    found = list(mutants())
    kinds = len(State) - 1 + len(EVENTS) - 1 + len(CONDITIONS) - 1 + len(State) - 1
    swaps = len(RULES) - len({(rule.at, rule.on) for rule in RULES})
    assert len(found) == len(RULES) * (1 + kinds + len(ACTIONS) - 1) + swaps
    assert len(found) > 60
    assert holds(RULES)
    assert [what for what, table in found if holds(table)] == []
