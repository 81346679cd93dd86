"""Drawing of the automaton, the parameter editor, and the log as HTML."""

import re

import pytest

from quadctl.cli.console.model import STATES, WAYS, Verdict, drawing
from quadctl.cli.console.panels import line
from quadctl.cli.console.settings import shown, tables
from quadctl.schemas.params import FIXED_AT_LAUNCH
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params import catalogue
from quadctl.services.safety.automaton import RULES

SETTINGS = {setting.name: setting for table in tables({}) for setting in table.settings}


def test_the_drawn_transitions_are_those_of_the_rule_table():
    assert set(WAYS) == {(rule.at.name, rule.to.name) for rule in RULES if rule.at != rule.to}


def test_the_drawing_shows_every_state_within_its_frame():
    svg = drawing()
    assert [f"state-{name}" in svg for name in STATES] == [True] * 3
    width = float(re.findall(r'viewBox="0 0 (\d+)', svg)[0])
    assert all(0 <= float(x) <= width for x in re.findall(r' x="([\d.]+)"', svg))


def test_every_parameter_is_shown_with_its_bounds_and_meaning():
    assert set(SETTINGS) == set(catalogue.leaves())
    speed = SETTINGS["dynamics.control.max_speed"]
    assert speed.facts == "[0.1, 100] m/s · default 5.0"
    assert all(setting.about for setting in SETTINGS.values())


def test_parameters_fixed_at_launch_are_marked_and_not_editable():
    fixed = {name for name, setting in SETTINGS.items() if setting.fixed}
    assert fixed == {*FIXED_AT_LAUNCH, "supervise.answer_timeout", "processes"}
    assert all("set at launch" in SETTINGS[name].facts for name in fixed)


def test_each_type_has_its_own_editor():
    assert SETTINGS["safety.cage_on"].way == "switch"
    assert {"none", "stuck"} < set(SETTINGS["pressure.fault.kind"].choices)
    assert SETTINGS["safety.takeoff"].way == "text"


@pytest.mark.parametrize(("typed", "value"), [("2", 2), (" 1e-3 ", 0.001), ("-1", -1)])
def test_a_number_is_read_as_typed(typed, value):
    assert SETTINGS["safety.takeoff"].read(typed) == value


def test_an_empty_input_is_rejected():
    with pytest.raises(Invalid, match=r"safety\.takeoff"):
        SETTINGS["safety.takeoff"].read("  ")


@pytest.mark.parametrize("value", [1.0, 5, "word", "", True, [1, 2], "two words"])
def test_a_shown_value_reads_back_the_same(value):
    assert SETTINGS["safety.takeoff"].read(shown(value)) == value


def test_a_users_own_node_has_a_table():
    [own] = [table for table in tables({"mine.gain": 2.0}) if table.name == "mine"]
    assert [(setting.label, setting.fixed) for setting in own.settings] == [("gain", False)]


def test_markup_and_controls_in_a_reason_are_escaped():
    shown_line = line(Verdict(1.0, "refused", "<img src=x onerror=alert(1)>\u202eb"))
    assert "<img" not in shown_line
    assert "\\u202eb" in shown_line
