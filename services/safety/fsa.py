"""The safety automaton: everything that moves it stands in RULES, and in nothing else.

    HOVERING -> VERIFYING -> MOVING -> HOVERING

`step` is pure: the pose, the cage and the clock's verdicts come in with the event and the world.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from msgspec.structs import replace

from services.safety.actions import (
    arrive,
    consider,
    follow,
    keep,
    note,
    pause,
    reboot,
    refuse,
    refuse_blind,
    refuse_busy,
    resize,
    resize_and_stop,
    resume,
    settle,
    stop,
    stop_astonished,
    take,
    toggle,
    toggle_and_stop,
)
from services.safety.conditions import (
    always,
    arrived,
    barred,
    blind,
    from_flight,
    jumped,
    may_replace,
    paused,
    permitted,
    settled,
    stranded,
    straying,
)
from services.safety.model import (
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


class Rule(NamedTuple):
    """At a state, on an event, when a condition holds: to a state, by an action."""

    at: State
    on: type[Event]
    when: Callable[[Situation, Event, World], bool]
    to: State
    do: Callable[[Situation, Event, World], Situation]


HOVERING, VERIFYING, MOVING = State

# The first rule that fits is taken. Every (state, event) has one that always does.
# fmt: off
RULES = (
    #    at         on       when         to         do
    Rule(HOVERING,  Ask,     blind,       HOVERING,  refuse_blind),
    Rule(HOVERING,  Ask,     always,      VERIFYING, consider),
    Rule(HOVERING,  Check,   always,      HOVERING,  keep),
    Rule(HOVERING,  Seen,    jumped,      HOVERING,  stop_astonished),
    Rule(HOVERING,  Seen,    straying,    HOVERING,  stop),
    Rule(HOVERING,  Seen,    paused,      MOVING,    resume),
    Rule(HOVERING,  Seen,    settled,     HOVERING,  settle),
    Rule(HOVERING,  Seen,    always,      HOVERING,  follow),
    Rule(HOVERING,  Lost,    always,      HOVERING,  keep),
    Rule(HOVERING,  Gone,    paused,      HOVERING,  stop),
    Rule(HOVERING,  Gone,    always,      HOVERING,  keep),
    Rule(HOVERING,  Lagged,  always,      HOVERING,  keep),
    Rule(HOVERING,  Halted,  always,      HOVERING,  keep),
    Rule(HOVERING,  Booted,  always,      HOVERING,  reboot),
    Rule(HOVERING,  Hold,    always,      HOVERING,  stop),
    Rule(HOVERING,  Toggle,  barred,      HOVERING,  toggle_and_stop),
    Rule(HOVERING,  Toggle,  always,      HOVERING,  toggle),
    Rule(HOVERING,  Resized, barred,      HOVERING,  resize_and_stop),
    Rule(HOVERING,  Resized, always,      HOVERING,  resize),
    Rule(VERIFYING, Check,   permitted,   MOVING,    take),
    Rule(VERIFYING, Check,   stranded,    HOVERING,  stop),
    Rule(VERIFYING, Check,   from_flight, MOVING,    refuse),
    Rule(VERIFYING, Check,   always,      HOVERING,  refuse),
    Rule(VERIFYING, Ask,     always,      VERIFYING, refuse_busy),
    Rule(VERIFYING, Seen,    always,      VERIFYING, keep),
    Rule(VERIFYING, Lost,    always,      HOVERING,  stop),
    Rule(VERIFYING, Gone,    always,      HOVERING,  stop),
    Rule(VERIFYING, Lagged,  always,      VERIFYING, keep),
    Rule(VERIFYING, Halted,  always,      HOVERING,  stop),
    Rule(VERIFYING, Booted,  always,      HOVERING,  reboot),
    Rule(VERIFYING, Hold,    always,      HOVERING,  stop),
    Rule(VERIFYING, Toggle,  always,      VERIFYING, toggle),
    Rule(VERIFYING, Resized, always,      VERIFYING, resize),
    Rule(MOVING,    Ask,     blind,       MOVING,    refuse_blind),
    Rule(MOVING,    Ask,     may_replace, VERIFYING, consider),
    Rule(MOVING,    Ask,     always,      MOVING,    refuse_busy),
    Rule(MOVING,    Check,   always,      MOVING,    keep),
    Rule(MOVING,    Seen,    jumped,      HOVERING,  stop_astonished),
    Rule(MOVING,    Seen,    straying,    HOVERING,  stop),
    Rule(MOVING,    Seen,    arrived,     HOVERING,  arrive),
    Rule(MOVING,    Seen,    always,      MOVING,    follow),
    Rule(MOVING,    Lost,    always,      HOVERING,  pause),
    Rule(MOVING,    Gone,    always,      HOVERING,  stop),
    Rule(MOVING,    Lagged,  always,      MOVING,    note),
    Rule(MOVING,    Halted,  always,      HOVERING,  stop),
    Rule(MOVING,    Booted,  always,      HOVERING,  reboot),
    Rule(MOVING,    Hold,    always,      HOVERING,  stop),
    Rule(MOVING,    Toggle,  barred,      HOVERING,  toggle_and_stop),
    Rule(MOVING,    Toggle,  always,      MOVING,    toggle),
    Rule(MOVING,    Resized, barred,      HOVERING,  resize_and_stop),
    Rule(MOVING,    Resized, always,      MOVING,    resize),
)
# fmt: on


Table = dict[tuple[State, type[Event]], tuple[Rule, ...]]


def by_place(rules: Iterable[Rule]) -> Table:
    """The rules for each state and event, in their order: what a step has to look through."""
    table: Table = {}
    for rule in rules:
        table[rule.at, rule.on] = (*table.get((rule.at, rule.on), ()), rule)
    return table


_TABLE = by_place(RULES)


def step(
    situation: Situation, event: Event, world: World, rules: tuple[Rule, ...] = RULES
) -> Situation:
    """The situation after an event; pure.

    Raises LookupError where no rule fits, which the tests show never to be.
    """
    table = _TABLE if rules is RULES else by_place(rules)
    for rule in table.get((situation.state, type(event)), ()):
        if rule.when(situation, event, world):
            after = rule.do(situation, event, world)
            return after if after.state is rule.to else replace(after, state=rule.to)
    raise LookupError(f"no rule for {situation.state} and {event}")
