"""Rubrics: what they may have, what is drawn, and what is refused, with the row and the key."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from quadctl.cli.lab.rubric import (
    drawn,
    rubric,
    selected,
    visible,
)
from quadctl.services.runtime.errors import Invalid, UsageError

LAB = Path(__file__).parents[2] / "cli/lab"
GOTO = 'rows = [{ at = 3.0, do = "goto", x = 9.0, y = 0.0, z = 1.0 }]\n'


def read(text: str):
    return rubric(tomllib.loads(text), "r.toml")


def test_the_row_of_the_manual_is_one():
    (row,) = read(f"""
        [[row]]
        name = "refuses a goal outside"
        points = 2.0
        visible = true
        hint = "compare all three coordinates"
        {GOTO}
        expect = "refused"
        """).rows
    assert (row.points, row.visible, row.number, row.about) == (2.0, True, "1", "safety")


@pytest.mark.parametrize("file", ["rubric.toml", "extra.toml", "hidden.toml"])
def test_the_built_in_rows_are_a_rubric_with_hints(file: str):
    made = rubric(tomllib.loads((LAB / file).read_text("utf-8")), file)
    assert all(row.hint and row.points and row.number for row in made.rows)
    assert [row.visible for row in made.rows] == [file != "hidden.toml"] * len(made.rows)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("rows = 1", "unknown field `rows`"),
        ("row = []", "length >= 1"),
        ("[[row]]\nexpect = 'refused'", "missing required field `name`"),
        ("[[row]]\nname = 'a'\nexpect = 'refuse'", "Invalid enum value 'refuse'"),
        ("[[row]]\nname = 'a'\npoint = 1", "there is no key point"),
        (f"[[row]]\nname = 'a'\nexpect = 'refused'\nflights = 3\n{GOTO}", "takes no flights"),
        ("[[row]]\nname = 'a'\nexpect = 'refused'", "Expected `array` of length >= 1|length"),
        (f"[[row]]\nname = 'a'\nexpect = 'random_flights'\n{GOTO}", "missions of its own"),
        (f"[[row]]\nname = 'a'\nexpect = 'state_seen'\n{GOTO}", "needs a state"),
        (f"[[row]]\nname = 'a'\nexpect = 'zeroed'\n{GOTO}", "needs a calibrate"),
        (
            f"[[row]]\nname = 'a'\nexpect = 'answers'\nservice = 'toggle'\n{GOTO}",
            "there is no service toggle",
        ),
        (
            f"[[row]]\nname = 'a'\nexpect = 'answers'\nservice = 'toggle_cage'\n{GOTO}",
            "no row of its mission calls toggle_cage",
        ),
        (f"[[row]]\nname = 'a'\nexpect = 'stops'\n{GOTO}", "needs a goto and then a cage"),
        (
            (
                "[[row]]\nname = 'a'\nexpect = 'refused'\nrows = ["
                "{ at = 4.0, do = 'goto', x = 9, y = 0, z = 1, optional = true }]"
            ),
            "each of its steps is optional",
        ),
        (
            (
                "[[row]]\nname = 'a'\nexpect = 'zeroed'\nrows = [{ at = 4.0, do = 'hold' }, "
                "{ at = 6.0, do = 'calibrate', optional = true }]"
            ),
            "needs a calibrate",
        ),
        (
            (
                "[[row]]\nname = 'a'\nexpect = 'refused'\nrows = ["
                "{ at = 4.0, do = 'goto', x = [9.0, 8.0], y = 0, z = 1 }]"
            ),
            "the lower number comes first",
        ),
        (
            (
                "[[row]]\nname = 'a'\nexpect = 'stops'\nrows = ["
                "{ at = 1.0, do = 'cage', on = true }, { at = 3.0, do = 'goto', x = 9, y = 0, z = 1 }]"
            ),
            "needs a goto and then a cage",
        ),
        (
            "[[row]]\nname = 'a'\nexpect = 'arrives'\nrows = [{ at = 1.0, do = 'hold' }]",
            "needs a goto",
        ),
        (
            f"[[row]]\nname = 'a'\nexpect = 'refused'\npoints = -1\n{GOTO}",
            "Expected `float` >= 0",
        ),
        (
            2 * f"[[row]]\nname = 'a'\nexpect = 'refused'\n{GOTO}",
            "two rows have the name 'a'",
        ),
        ("[[row]]\nname = 'a'\nexpect = 'refused'\nrows = [{ at = 1.0, do = 'fly' }]", "fly"),
        (f"[[row]]\nname = 'a'\nexpect = 'prints'\n{GOTO}", "prints needs lines"),
        (f"[[row]]\nname = 'a'\nexpect = 'replies'\n{GOTO}", "replies needs a call"),
        (f"[[row]]\nname = 'a'\nexpect = 'takes_waypoints'\n{GOTO}", "needs `waypoints`"),
        (
            (
                "[[row]]\nname = 'a'\nexpect = 'takes_waypoints'\nend = 3.0\n"
                "waypoints = [{ at = 3.0, x = 1.0, y = 0.0, z = 1.0 }]"
            ),
            "each waypoint needs a later time",
        ),
    ],
)
def test_a_bad_rubric_is_refused_with_its_place(text: str, error: str):
    with pytest.raises(Invalid, match=error) as refused:
        read(text)
    assert refused.value.message.startswith("r.toml")


RANDOM = {"name": "a", "expect": "random_flights", "visible": False}
TABLES: dict[str, Any] = {
    "row": [
        RANDOM, RANDOM | {"name": "b", "seed": 3}, RANDOM | {"name": "c", "visible": True, "number": "x"},
        {"name": "d", "expect": "arrives", "visible": False},
    ]
}  # fmt: skip


@pytest.mark.parametrize(
    ("number", "hint"), [("X", "did you mean x?"), ("77", "one of 1, 2, x, 4")]
)
def test_an_unknown_row_is_refused(number: str, hint: str):
    with pytest.raises(UsageError, match=f"--row {number}: the rubric has no such row") as caught:
        selected(TABLES, ["1", number])
    assert caught.value.hint == hint


def test_hidden_rows_without_a_seed_are_drawn_from_the_one_of_the_class():
    seeds = [row.get("seed") for row in drawn(TABLES, 4711)["row"]]
    assert seeds == [4711, 3, None, None]
    assert drawn(TABLES, 4711) != TABLES
    builtin = tomllib.loads((LAB / "hidden.toml").read_text("utf-8"))
    assert [row.seed for row in rubric(drawn(builtin, 4711), "hidden.toml").rows] == [4711]


def test_rows_that_are_left_keep_their_numbers():
    assert [(row["name"], row["number"]) for row in visible(TABLES)["row"]] == [("c", "x")]
    rows = selected(TABLES, ["4", "x"])["row"]
    assert [(row["name"], row["number"]) for row in rows] == [("c", "x"), ("d", "4")]


CHANCE = """
[[row]]
name = "a"
expect = "parameter_obeyed"
rows = [
    { at = 3.0, do = "goto", x = [1.0, 2.0], y = 0.5, z = [1, 2] },
    { at = 9.0, do = "goto", x = 0.0, y = 0.0, z = 1.0, optional = true },
]
"""


def test_what_is_left_to_chance_is_drawn_from_the_seed_and_the_rows_name():
    tables = tomllib.loads(CHANCE)
    found = {seed: drawn(tables, seed)["row"][0]["rows"] for seed in range(40)}
    assert drawn(tables, 7)["row"][0]["rows"] == found[7]
    assert {len(steps) for steps in found.values()} == {1, 2}
    places = {(step["x"], step["y"], step["z"]) for step, *_ in found.values()}
    assert len(places) == 40
    assert all(1 <= x <= 2 and y == 0.5 and 1 <= z <= 2 for x, y, z in places)
    assert rubric(tables, "r.toml").missions == rubric(drawn(tables, 0), "r.toml").missions
    other = tables["row"][0] | {"name": "b"}
    assert drawn({"row": [other]}, 7)["row"][0]["rows"] != found[7]
    assert drawn(drawn(tables, 7), 8) == drawn(tables, 7)
    assert "optional" in tables["row"][0]["rows"][1]


@pytest.mark.parametrize(
    ("keys", "error"),
    [
        ("x = [1.0], y = 0.0, z = 1.0", "expected float, got array"),
        ("x = [1.0, 2.0, 3.0], y = 0.0, z = 1.0", "expected float, got array"),
        ('x = ["1", "2"], y = 0.0, z = 1.0', "expected float, got array"),
        ("x = 0.0, y = 0.0, z = 1.0, optional = 1", "optional = 1"),
    ],
)
def test_a_wrong_range_is_refused(keys: str, error: str):
    rows = f'rows = [{{ at = 3.0, do = "goto", {keys} }}]'
    with pytest.raises(Invalid, match=error):
        read(f'[[row]]\nname = "a"\nexpect = "arrives"\n{rows}')


@pytest.mark.parametrize(
    ("keys", "hint"),
    [
        ("expect = 'zerod'", "did you mean zeroed? expect is one of refused, arrives, "),
        ("expect = 'xxxxx'", "expect is one of refused, arrives, "),
        ("expect = 'state_seen'\nstate = 'MOVE'", "state is one of HOVERING, VERIFYING, MOVING"),
    ],
)
def test_a_wrong_word_in_a_rubric_gets_those_that_are_allowed(keys: str, hint: str):
    with pytest.raises(Invalid) as refused:
        rubric(tomllib.loads(f"[[row]]\nname = 'a'\n{keys}\n"), "r.toml")
    assert hint in refused.value.hint
