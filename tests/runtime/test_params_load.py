"""Parameters from defaults, file and `--set`: which one counts, and how they may be written."""

from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadctl.schemas.barometer import PressureParams
from quadctl.schemas.params import CageParams, Params, SafetyParams, StartParams
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.load import check, launch_lines, load
from quadctl.services.runtime.params.names import flatten, nearest, normal_name, put, value_of

CHUNK = st.text("abcdef_", min_size=1, max_size=6)
LEAVES = st.integers() | st.booleans() | CHUNK
TABLES = st.recursive(
    st.dictionaries(CHUNK, LEAVES, min_size=1, max_size=3),
    lambda inner: st.dictionaries(CHUNK, inner | LEAVES, min_size=1, max_size=3),
    max_leaves=12,
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "lab.toml"


def test_without_a_file_the_defaults_in_code_count():
    params = load(None)
    assert params == Params()
    assert params.safety.virtual_cage == CageParams(5.0, 5.0, 5.0)
    assert params.safety.acceptance_range == 0.5


def test_the_file_goes_before_the_defaults_and_set_before_the_file(file: Path):
    file.write_text("[safety]\ntakeoff = 2\nvirtual_cage = { x = 3, y = 3, z = 3 }\n")
    params = load(file, ["safety.virtual_cage.x=4"])
    assert params.safety == SafetyParams(takeoff=2.0, virtual_cage=CageParams(4.0, 3.0, 3.0))
    assert params.pressure == PressureParams()


def test_the_last_set_counts():
    assert load(None, ["pressure.rate=1", "pressure.rate=2"]).pressure.rate == 2.0


def test_a_running_systems_values_go_before_the_defaults_and_below_set():
    running = Params(pressure=PressureParams(rate=20.0, noise=0.5))
    params = load(None, ["pressure.rate=30"], running)
    assert params.pressure == PressureParams(rate=30.0, noise=0.5)
    assert running.pressure.rate == 20.0


def test_a_file_of_ones_own_goes_before_a_running_systems_values(file: Path):
    file.write_text("[pressure]\nrate = 5\n")
    assert load(file, (), Params(pressure=PressureParams(noise=0.5))).pressure == PressureParams(
        rate=5.0
    )


def test_an_empty_file_is_the_defaults(file: Path):
    file.write_text("")
    assert load(file) == Params()


def test_of_another_vehicle_what_differs_is_logged_alone(file: Path):
    file.write_text("[safety]\nacceptance_range = 0.25\n")
    first, other = SafetyParams(), load(file).safety
    assert list(launch_lines(other, first)) == [
        "Launching with the first vehicle's parameters but for the following:",
        "Param: acceptance range - 0.25",
    ]
    assert list(launch_lines(other, other)) == []


def test_changing_cage_and_range_in_the_file_alone_changes_the_logged_lines(file: Path):
    file.write_text("[safety]\nacceptance_range = 0.25\nvirtual_cage = { x = 3, y = 3, z = 3 }\n")
    lines = list(launch_lines(load(file).safety))
    assert lines[0] == "Launching with the following parameters:"
    assert "Param: acceptance range - 0.25" in lines
    assert "Param: virtual cage x - 3.0" in lines
    assert "Param: cage on - True" in lines
    assert len(lines) == 1 + len(dict(flatten(msgspec.to_builtins(SafetyParams()))))


@pytest.mark.parametrize(
    "setting",
    [
        "safety.virtual_cage.x=3",
        "safety.virtual_cage.x=3.0",
        "safety.virtual_cage.x = 3",
        "/safety/virtual_cage/x=3",
        "safety/virtual_cage/x=3e0",
        "safety.virtual_cage={ x = 3 }",
    ],
)
def test_a_set_may_be_written_in_these_ways(setting: str):
    assert load(None, [setting]).safety.virtual_cage.x == 3.0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3), ("-0.5", -0.5), ("1e-5", 1e-5), ("true", True), ("True", True), ("False", False),
        ('"unix"', "unix"), ("unix", "unix"), ("[1, 2]", [1, 2]), ("{ x = 1 }", {"x": 1}),
        ("", ""), ("tcp/127.0.0.1:7447", "tcp/127.0.0.1:7447"), ("a b", "a b"), ("1_000", 1000),
    ],
)  # fmt: skip
def test_a_value_is_read_as_toml_or_as_a_word(text: str, value: object):
    read = value_of(text)
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize("text", ["True", "true"])
def test_ros_booleans_are_understood(text: str):
    off = load(None, ["safety.cage_on=False"])
    assert not off.safety.cage_on
    assert load(None, [f"safety.cage_on={text}"], off).safety.cage_on


def test_words_and_lists_reach_the_parameters():
    params = load(None, ["hub.transport=tcp", 'hub.listen=["tcp/127.0.0.1:7447"]'])
    assert params.hub.transport == "tcp"
    assert params.hub.listen == ["tcp/127.0.0.1:7447"]


def test_processes_take_a_line_or_a_list(file: Path):
    file.write_text('[processes]\nsafety = "python my_safety.py"\nmine = ["sleep", "9"]\n')
    assert load(file).processes == {"safety": "python my_safety.py", "mine": ["sleep", "9"]}
    assert load(None, ["processes.mine=sleep 9"]).processes == {"mine": "sleep 9"}


@pytest.mark.parametrize(
    ("name", "normal"),
    [("/safety/virtual_cage/x", "safety.virtual_cage.x"), ("safety.takeoff", "safety.takeoff"),
     ("pressure/rate", "pressure.rate"), ("/safety/", "safety")],
)  # fmt: skip
def test_names_as_ros_users_write_them(name: str, normal: str):
    assert normal_name(name) == normal


@given(TABLES)
def test_a_table_taken_apart_can_be_put_together(table: dict[str, object]):
    built: dict[str, object] = {}
    for name, value in flatten(table):
        put(built, name, value, "here")
    assert built == table


def test_a_value_is_not_a_table():
    with pytest.raises(Invalid, match=r"--set x: safety\.takeoff is a value and has no x"):
        put({"safety": {"takeoff": 1.0}}, "safety.takeoff.x", 3, "--set x")


@pytest.mark.parametrize(
    ("name", "meant"),
    [("virtual_cage", "virtual_cag"), ("rate", "rates"), ("transport", "Transport")],
)
def test_the_nearest_name_is_offered(name: str, meant: str):
    assert nearest(meant, ["virtual_cage", "rate", "transport"]) == f"did you mean {name}?"
    assert nearest("zzzzzz", ["virtual_cage", "rate"]) == ""


def test_checking_makes_no_shared_tables():
    one, other = check({}, "here"), check({}, "here")
    one.safety.virtual_cage.x = 1.0
    one.dynamics.start = StartParams(1.0)
    assert other == Params() == check({}, "here")
