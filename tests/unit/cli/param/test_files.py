"""Parameter file edited in place: every other character is kept."""

import tomllib
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from quadctl.cli.param.files import edited
from quadctl.services.runtime.params.catalogue import render
from quadctl.services.runtime.params.names import put
from tests.support.declared_values import changed_values

WRITTEN = [
    ("[safety]\ntakeoff = 1.0 # high\n", "[safety]\ntakeoff = 2.5 # high\n"),
    ("[ safety ]\n'takeoff'=1.0\n", "[ safety ]\n'takeoff'=2.5\n"),
    ("safety.takeoff = 1.0\n# end", "safety.takeoff = 2.5\n# end"),
    (
        "safety = { takeoff = 1.0, cage_on = true }\n",
        "safety = { takeoff = 2.5, cage_on = true }\n",
    ),
    ("# mine\r\n[safety]\r\ntakeoff = 1.0\r\n", "# mine\r\n[safety]\r\ntakeoff = 2.5\r\n"),
    ("[safety]\ntakeoff = 1.0", "[safety]\ntakeoff = 2.5"),
]


@pytest.mark.parametrize(("before", "after"), WRITTEN)
def test_a_value_is_replaced_in_place(before: str, after: str):
    assert edited(before, {"safety.takeoff": 2.5}) == after


@pytest.mark.parametrize(
    "before",
    ["", "# nothing\n", "[safety]\n", "[pressure]\nrate = 5.0\n", "[safety.virtual_cage]\nx = 3.0\n",
     "[safety.virtual_cage]\nx = 3.0\n[pressure]\nrate = 5.0\n[safety]\ncage_on = false\n",
     "[dynamics.vehicle]\nmass = 2.0\n", "safety.cage_on = false", "safety = {}\n"],
)  # fmt: skip
def test_missing_values_are_added_and_the_rest_is_kept(before: str):
    values: dict[str, Any] = {
        "safety.takeoff": 2.5,
        "safety.virtual_cage.y": 4.0,
        "dynamics.rate": 50.0,
    }
    after = edited(before, values)
    wanted = tomllib.loads(before)
    for name, value in values.items():
        put(wanted, name, value, "")
    assert tomllib.loads(after) == wanted
    assert [line for line in before.splitlines() if line not in after.splitlines()] in (
        [], ["safety = {}"],
    )  # fmt: skip


@pytest.mark.thorough
@settings(max_examples=40)
@given(changed_values(), st.sampled_from([render(), "", render().replace("\n", "\r\n")]))
def test_any_set_of_values_is_written(values: dict[str, Any], before: str):
    wanted = tomllib.loads(before)
    for name, value in values.items():
        put(wanted, name, value, "")
    after = edited(before, values)
    assert tomllib.loads(after) == wanted
    comments = [line for line in before.splitlines() if line.startswith("#")]
    assert [line for line in after.splitlines() if line.startswith("#")] == comments


def test_without_values_the_text_is_unchanged():
    assert edited(render(), {}) == render()
