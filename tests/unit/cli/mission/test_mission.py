"""Mission file: its rows as service calls, and the errors of an invalid file."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadctl.cli.mission.mission import AFTER, CageStep, Calibrate, GotoStep, HoldStep, mission
from quadctl.schemas.services import CalibrateRequest, GotoRequest, HoldRequest, ToggleCageRequest
from quadctl.schemas.topics import CALIBRATE, GOTO, HOLD, TOGGLE_CAGE
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.load import parse

HOLD_AT_1 = {"at": 1, "do": "hold"}


def test_each_row_is_a_call_of_an_ordinary_service():
    text = """
    end = 9
    [[rows]]
    at = 2.5
    do = "goto"
    x = 1
    y = -2.0
    z = 1.5
    replace = true
    [[rows]]
    at = 3
    do = "cage"
    on = false
    [[rows]]
    at = 3
    do = "hold"
    [[rows]]
    at = 4
    do = "calibrate"
    [[rows]]
    at = 5
    do = "calibrate"
    unset = true
    """
    found = mission(parse(text, "m"), "m")
    assert found.end == 9
    assert [row.call() for row in found.rows] == [
        (GOTO, GotoRequest(1, -2, 1.5, replace=True)),
        (TOGGLE_CAGE, ToggleCageRequest(cage_on=False)),
        (HOLD, HoldRequest()),
        (CALIBRATE, CalibrateRequest(zero=True)),
        (CALIBRATE, CalibrateRequest(zero=False)),
    ]
    assert [str(row) for row in found.rows] == [
        "goto 1 -2 1.5 --replace", "cage off", "hold", "calibrate", "calibrate --unset",
    ]  # fmt: skip


def test_without_an_end_a_mission_ends_after_its_last_row():
    assert mission({"rows": [HOLD_AT_1]}, "m").end == 1 + AFTER
    assert mission({"rows": [HOLD_AT_1], "end": 1}, "m").end == 1


@given(st.lists(st.tuples(st.integers(0, 5), st.sampled_from(["hold", "calibrate"])), min_size=1))
def test_rows_are_sorted_by_time_and_ties_keep_the_file_order(given_rows):
    rows = mission({"rows": [{"at": at, "do": do} for at, do in given_rows]}, "m").rows
    kinds = {"hold": HoldStep, "calibrate": Calibrate}
    expected = sorted(given_rows, key=lambda row: row[0])
    assert [(row.at, type(row)) for row in rows] == [(at, kinds[do]) for at, do in expected]


@pytest.mark.parametrize(
    ("row", "message", "hint"),
    [
        ({"at": 1}, "row 2: `do` is missing", "goto"),
        ({"at": 1, "do": "gotoo"}, "row 2: do = 'gotoo' is no command", "did you mean goto?"),
        ({"at": 1, "do": ["goto"]}, "row 2: do = ['goto'] is no command", "goto"),
        ({"do": "hold"}, "row 2: object missing required field at", "hold takes at"),
        ({"at": -1, "do": "hold"}, "row 2: at: expected float >= 0.0", "hold takes at"),
        ({"at": float("nan"), "do": "hold"}, "row 2: at: expected float >= 0.0", ""),
        ({"at": 1, "do": "cage"}, "row 2: object missing required field on", "cage takes at, on"),
        ({"at": 1, "do": "cage", "on": 1}, "row 2: on: expected bool, got int", ""),
        (
            {"at": 1, "do": "goto", "x": 1, "y": 2, "z": "up"},
            "row 2: z: expected float, got str",
            "goto takes at, x, y, z, replace",
        ),
        (
            {"at": 1, "do": "goto", "x": 1, "y": 2, "z": 2e4},
            "row 2: z: expected float <= 10000.0",
            "",
        ),
        (
            {"at": 1, "do": "goto", "x": 1, "y": 2, "z": 1, "replaced": True},
            "row 2: object contains unknown field replaced",
            "did you mean replace?",
        ),
    ],
)
def test_an_error_in_a_row_names_its_number(row: dict, message: str, hint: str):
    with pytest.raises(Invalid) as caught:
        mission({"rows": [HOLD_AT_1, row]}, "m.toml")
    assert f"m.toml: {message}" in caught.value.message
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({}, "object missing required field rows"),
        ({"rows": []}, "rows: expected array of length >= 1"),
        ({"rows": [1]}, "rows[0]: expected object, got int"),
        ({"rows": {"at": 1}}, "rows: expected array, got object"),
        ({"row": [HOLD_AT_1], "rows": [HOLD_AT_1]}, "unknown field row"),
        ({"rows": [HOLD_AT_1], "end": "late"}, "end: expected float"),
        ({"rows": [HOLD_AT_1], "end": 0.5}, "end = 0.5: the last row is at 1 s"),
    ],
)
def test_an_error_in_the_file_names_the_field(tables: dict, message: str):
    with pytest.raises(Invalid, match=r"m\.toml: ") as caught:
        mission(tables, "m.toml")
    assert message in caught.value.message


def test_the_example_has_every_kind_of_row(request: pytest.FixtureRequest):
    file = request.config.rootpath / "examples" / "mission.toml"
    rows = mission(parse(file.read_text(encoding="utf-8"), str(file)), str(file)).rows
    assert {type(row) for row in rows} == {GotoStep, CageStep, HoldStep, Calibrate}
    assert any(isinstance(row, GotoStep) and row.replace for row in rows)
