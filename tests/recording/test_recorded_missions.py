"""Recordings played to the current services: their output must equal the recorded output.

A change of behaviour fails here. If it is intended, make the recordings again
(`python -m tests.golden.write NAME`).
"""

from functools import partial
from pathlib import Path
from typing import Any

import pytest

from quadctl.services.pressure.__main__ import run as run_pressure
from quadctl.services.runtime.testing import Published, play
from quadctl.services.safety import automaton
from quadctl.services.safety.__main__ import run as run_safety
from tests.support.recorded import Recorded

FILES = sorted((Path(__file__).parent / "data").glob("*.mcap"))


@pytest.fixture(scope="module", params=FILES, ids=lambda file: file.stem)
def recorded(request) -> Recorded:
    return Recorded(request.param)


def safety(recorded: Recorded) -> list[Published]:
    return play("safety", run_safety, recorded.params, recorded.received, recorded.calls)


def same(now: list, then: list) -> bool:
    """Return whether both are equal; the recording may end one message early."""
    return now[: len(then)] == then and len(now) - len(then) <= 1


def test_safety_decides_as_recorded(recorded):
    said = safety(recorded)
    assert recorded.transitions(said) == recorded.transitions(recorded.published)
    assert same(recorded.setpoints(said), recorded.setpoints(recorded.published))
    assert len(recorded.transitions(said)) > 3
    assert len(recorded.setpoints(said)) > 100


def test_the_barometer_reads_as_recorded(recorded):
    said = play("pressure", run_pressure, recorded.params, recorded.received, recorded.calls)
    readings = recorded.readings(recorded.published)
    assert same(recorded.readings(said), readings)
    assert len(readings) > 50
    assert {bool(reading.baseline) for reading in readings} == {True, False}


def rule_index(*names: Any) -> int:
    """Return the index of the rule with a given state, event and condition."""
    found = [(r.at.name, r.on.__name__, r.when.__name__) for r in automaton.RULES]
    return found.index(names)


@pytest.mark.parametrize(
    "rule",
    [
        ("HOVERING", "Goto", "always"),
        ("VERIFYING", "Check", "permitted"),
        ("MOVING", "Goto", "may_replace"),
        ("MOVING", "Seen", "arrived"),
        ("MOVING", "Hold", "always"),
        ("HOVERING", "Toggle", "always"),
    ],
    ids="-".join,
)
def test_one_changed_rule_changes_the_flight(rule, monkeypatch):
    recorded = Recorded(Path(__file__).parent / "data" / "cage.mcap")
    number = rule_index(*rule)
    changed = automaton.RULES[number]._replace(do=automaton.keep, to=automaton.RULES[number].at)
    rules = (*automaton.RULES[:number], changed, *automaton.RULES[number + 1 :])
    monkeypatch.setattr(
        "quadctl.services.safety.monitor.step", partial(automaton.step, rules=rules)
    )
    said = safety(recorded)
    assert recorded.transitions(said) != recorded.transitions(recorded.published)


def test_another_noise_seed_changes_the_readings():
    recorded = Recorded(Path(__file__).parent / "data" / "barometer.mcap")
    recorded.params.dynamics.seed += 1
    said = play("pressure", run_pressure, recorded.params, recorded.received, recorded.calls)
    assert not same(recorded.readings(said), recorded.readings(recorded.published))
