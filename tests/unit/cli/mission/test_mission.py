"""Mission file: its rows as service calls, and the errors of an invalid file."""

import pytest
from hypothesis import given, strategies as st

from quadctl.cli.mission.mission import (
    AFTER,
    CageStep,
    Calibrate,
    GotoStep,
    HoldStep,
    ParamStep,
    mission,
)
from quadctl.schemas.params import (
    CageParams,
    DynamicsParams,
    Params,
    SafetyParams,
    StartParams,
)
from quadctl.schemas.services import (
    CalibrateRequest,
    GotoRequest,
    HoldRequest,
    SetParamsRequest,
    ToggleCageRequest,
)
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
    [[rows]]
    at = 6
    do = "param"
    name = "dynamics.control.max_acceleration"
    value = 4
    [[rows]]
    at = 7
    do = "param"
    name = "/safety/virtual_cage"
    value = { x = 2.5, z = 1.0 }
    """
    found = mission(parse(text, "m"), "m")
    assert found.end == 9
    assert found.params is None
    *others, one, several = [row.call() for row in found.rows]
    assert one[0].name == "dynamics/set_params"
    assert one[1] == SetParamsRequest({"dynamics.control.max_acceleration": 4})
    assert several[0].name == "safety/set_params"
    assert several[1] == SetParamsRequest(
        {"safety.virtual_cage.x": 2.5, "safety.virtual_cage.z": 1.0}
    )
    assert others == [
        (GOTO, GotoRequest(1, -2, 1.5, replace=True)),
        (TOGGLE_CAGE, ToggleCageRequest(cage_on=False)),
        (HOLD, HoldRequest()),
        (CALIBRATE, CalibrateRequest(zero=True)),
        (CALIBRATE, CalibrateRequest(zero=False)),
    ]
    assert [str(row) for row in found.rows] == [
        "goto 1 -2 1.5 --replace", "cage off", "hold", "calibrate", "calibrate --unset",
        "param set dynamics.control.max_acceleration 4",
        "param set /safety/virtual_cage { x = 2.5, z = 1.0 }",
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
    ("name", "value", "message", "hint"),
    [
        ("safety.virtual_cag.x", 1, "unknown parameter safety.virtual_cag.x", "virtual_cage.x?"),
        (
            "safety",
            {"takeof": 1},
            "unknown parameter safety.takeof",
            "did you mean safety.takeoff?",
        ),
        ("uav.safety.takeoff", 1, "unknown parameter uav.safety.takeoff", "safety.takeoff?"),
        ("safety.takeoff.x", 1, "unknown parameter safety.takeoff.x", ""),
        ("safety.takeoff", "high", "safety.takeoff: expected `float`, got `str`", ""),
        ("safety.takeoff", -1, "safety.takeoff: expected `float` >= 0.0", ""),
        ("safety.virtual_cage", 3, "safety.virtual_cage: expected `object`, got `int`", ""),
        ("pressure.fault.kind", "odd", "pressure.fault.kind: invalid enum value 'odd'", ""),
        ("dynamics.speed", 2, "dynamics.speed is fixed at launch", "set it under [set]"),
        ("dynamics", {"seed": 2}, "dynamics.seed is fixed at launch", "set it under [set]"),
        ("safety.cage_on", True, "safety.cage_on is fixed at launch", '`do = "cage"`'),
        ("hub.transport", "tcp", "hub.transport is fixed at launch", "--set hub.transport=..."),
        ("processes.more", "true", "processes.more is fixed at launch", "without [set]"),
    ],
)
def test_a_parameter_is_checked_when_the_file_is_read(
    name: str, value: object, message: str, hint: str
):
    row = {"at": 1, "do": "param", "name": name, "value": value}
    with pytest.raises(Invalid) as caught:
        mission({"rows": [HOLD_AT_1, row]}, "m.toml")
    assert caught.value.message.startswith(f"m.toml: row 2: {message}")
    assert hint in caught.value.hint


def test_rules_between_parameters_are_left_to_the_node():
    # On its own it is too heavy to fly; the running system may have stronger motors.
    row = {"at": 1, "do": "param", "name": "dynamics.vehicle.mass", "value": 9.0}
    assert mission({"rows": [row]}, "m").rows == [ParamStep(1, "dynamics.vehicle.mass", 9.0)]


def test_settings_are_parameters_of_a_run_as_fast_as_it_goes():
    text = """
    rows = [{ at = 1, do = "hold" }]
    [set]
    "safety.virtual_cage.x" = 2
    dynamics.start.z = 1.0
    """
    assert mission(parse(text, "m"), "m").params == Params(
        safety=SafetyParams(virtual_cage=CageParams(x=2.0)),
        dynamics=DynamicsParams(speed=0.0, start=StartParams(z=1.0)),
    )
    own = {"rows": [HOLD_AT_1], "set": {"dynamics.speed": 10}}
    assert mission(own, "m").params == Params(dynamics=DynamicsParams(speed=10.0))
    own = {"rows": [HOLD_AT_1], "set": {"dynamics.speed": 1}}
    assert mission(own, "m").params == Params(dynamics=DynamicsParams(speed=1.0, lockstep=True))
    defaults = Params(dynamics=DynamicsParams(speed=0.0))
    assert mission({"rows": [HOLD_AT_1], "set": {}}, "m").params == defaults


@pytest.mark.parametrize(
    ("settings", "message", "hint"),
    [
        ({"safety.takeof": 1}, "unknown parameter safety.takeof", "did you mean safety.takeoff?"),
        ({"safety": {"takeoff": -1}}, "safety.takeoff: expected `float` >= 0.0", ""),
        ({"safety": 1}, "safety: expected `object`, got `int`", ""),
        ({"safety.takeoff": 1, "safety": {"takeoff": 2}}, "safety.takeoff is set twice", ""),
        (
            {"dynamics.lockstep": False, "dynamics.speed": 1},
            "a mission flies in lock-step",
            "leave",
        ),
        ({"pressure.source": "iio"}, "pressure.source iio reads a real sensor", ""),
        ({"dynamics.vehicle.mass": 90}, "dynamics: this vehicle would not fly", ""),
        ({"hub": {"listen": ["tcp/0.0.0.0:1"]}}, "hub.listen is fixed at launch", "quadctl up"),
        ({"processes": {"more": "true"}}, "processes.more is fixed at launch", "without [set]"),
    ],
)
def test_an_error_in_a_setting_names_it(settings: dict, message: str, hint: str):
    with pytest.raises(Invalid) as caught:
        mission({"rows": [HOLD_AT_1], "set": settings}, "m.toml")
    assert caught.value.message.startswith("m.toml: [set]: ")
    assert message in caught.value.message
    assert hint in caught.value.hint


def test_rows_below_the_settings_are_missing_with_a_hint():
    with pytest.raises(Invalid) as caught:
        mission(parse('[set]\nsafety.takeoff = 1\nrows = [{ at = 1, do = "hold" }]', "m"), "m")
    assert "missing required field rows" in caught.value.message
    assert (
        caught.value.hint == "all that follows [set] belongs to it: move `rows` and `end` above it"
    )


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({}, "object missing required field rows"),
        ({"rows": []}, "rows: expected array of length >= 1"),
        ({"rows": [1]}, "rows[0]: expected object, got int"),
        ({"rows": {"at": 1}}, "rows: expected array, got object"),
        ({"row": [HOLD_AT_1], "rows": [HOLD_AT_1]}, "unknown field row"),
        ({"rows": [HOLD_AT_1], "end": "late"}, "end: expected float"),
        ({"rows": [HOLD_AT_1], "set": 3}, "set: expected object | null, got int"),
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
    assert {type(row) for row in rows} == {GotoStep, CageStep, HoldStep, Calibrate, ParamStep}
    assert any(isinstance(row, GotoStep) and row.replace for row in rows)
