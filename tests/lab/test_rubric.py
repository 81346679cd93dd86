"""Rubrics: what they may have, and what is refused, with the row and the key."""

import tomllib
from pathlib import Path

import pytest

from quadctl.cli.lab.rubric import rubric
from quadctl.services.runtime.errors import Invalid

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
    assert (row.points, row.visible, row.number, row.node) == (2.0, True, "1", "safety")


@pytest.mark.parametrize("file", ["rubric.toml", "hidden.toml"])
def test_the_built_in_rows_are_a_rubric_with_hints(file: str):
    made = rubric(tomllib.loads((LAB / file).read_text("utf-8")), file)
    assert all(row.hint and row.points and row.number for row in made.rows)
    assert [row.visible for row in made.rows] == [file == "rubric.toml"] * len(made.rows)


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
    ],
)
def test_a_bad_rubric_is_refused_with_its_place(text: str, error: str):
    with pytest.raises(Invalid, match=error) as refused:
        read(text)
    assert refused.value.message.startswith("r.toml")
