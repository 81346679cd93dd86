"""Parameters from defaults, file and `--set`: their precedence and their spellings."""

from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, strategies as st

from quadctl.schemas.barometer import PressureParams
from quadctl.schemas.params import CageParams, Params, SafetyParams, StartParams
from quadctl.schemas.topics import SETPOINT
from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.load import check, launch_lines, load, read
from quadctl.services.runtime.params.names import flatten, nearest, normal_name, put, value_of

FLOAT, TABLE = "expected `float`", "expected `object`"
# The file, the text that the error must contain, and the text of its hint.
FILES = [
    # Unknown names.
    ("[safty]", "unknown parameter safty", "safety"),
    ("[Safety]", "unknown parameter Safety", "safety"),
    ("takeoff = 1", "unknown parameter takeoff", "safety.takeoff"),
    ("[safety]\ntake_off = 1", "unknown parameter safety.take_off", "safety.takeoff"),
    ("[safety]\nacceptance_rnage = 1", "safety.acceptance_rnage", "safety.acceptance_range"),
    ("[safety.virtual_cage]\nw = 1", "safety.virtual_cage.w", "safety.virtual_cage."),
    ("[safety.virtual_cge]\nx = 1", "safety.virtual_cge", "safety.virtual_cage"),
    ("[pressure]\nrates = 1", "unknown parameter pressure.rates", "pressure.rate"),
    ("[dynamics]\nsped = 1", "unknown parameter dynamics.sped", "dynamics.speed"),
    ("[dynamics.vehicle]\nmas = 1", "dynamics.vehicle.mas", "dynamics.vehicle.mass"),
    ("[dynamics.control]\nmaxspeed = 1", "dynamics.control.maxspeed", "dynamics.control.max_speed"),
    ("[hub]\ntransports = 'tcp'", "unknown parameter hub.transports", "hub.transport"),
    ("[pressure]\nqqqqqqqqqqqqqqqqqqqqqqqqqqqqqq = 1", "qqqqq", "`quadctl init`"),
    # Wrong types.
    ("pressure = 3", f"pressure: {TABLE}, got `int`", ""),
    ("[safety]\nvirtual_cage = 5.0", f"safety.virtual_cage: {TABLE}", ""),
    ("[safety.virtual_cage]\nx = '3'", f"safety.virtual_cage.x: {FLOAT}, got `str`", ""),
    ("[safety]\ntakeoff = true", f"safety.takeoff: {FLOAT}, got `bool`", ""),
    ("[safety]\ntakeoff = [1.0]", f"safety.takeoff: {FLOAT}, got `array`", ""),
    ("[safety]\ntakeoff = 1979-05-27", f"safety.takeoff: {FLOAT}", ""),
    ("[safety]\ncage_on = 1", "safety.cage_on: expected `bool`, got `int`", ""),
    ("[safety]\ncage_on = 'true'", "safety.cage_on: expected `bool`, got `str`", ""),
    ("[dynamics]\nseed = 1.5", "dynamics.seed: expected `int`, got `float`", ""),
    ("[hub]\ntransport = 'udp'", "hub.transport: invalid enum value", ""),
    ("[hub]\nlisten = 'tcp/127.0.0.1:7447'", "hub.listen: expected `array`, got `str`", ""),
    ("[hub]\nlisten = [7447]", "hub.listen[0]: expected `str`, got `int`", ""),
    ("[processes]\nsafety = 3", "processes", ""),
    ("[processes]\nsafety = [3]", "processes", ""),
    # Numbers out of range.
    ("[safety]\ntakeoff = nan", "safety.takeoff: expected `float`", ""),
    ("[safety]\ntakeoff = inf", "safety.takeoff: expected `float` <= 10000", ""),
    ("[safety]\ntakeoff = -1", "safety.takeoff: expected `float` >= 0", ""),
    ("[safety]\nacceptance_range = 0", "safety.acceptance_range: expected `float` > 0", ""),
    ("[safety.virtual_cage]\nz = 0.1", "safety.virtual_cage.z: expected `float` >= 0.2", ""),
    ("[safety.virtual_cage]\nz = 10001", "safety.virtual_cage.z: expected `float` <= 10000", ""),
    ("[safety.virtual_cage]\nx = -5", "safety.virtual_cage.x: expected `float` >= 0.2", ""),
    ("[pressure]\nrate = 0", "pressure.rate: expected `float` > 0", ""),
    ("[pressure]\nrate = 1e400", "pressure.rate: expected `float` <= 200", ""),
    ("[pressure]\nnoise = -1e-9", "pressure.noise: expected `float` >= 0", ""),
    ("[dynamics]\nseed = -1", "dynamics.seed: expected `int` >= 0", ""),
    ("[dynamics]\nrate = 30", "1000 / rate must be a whole number", ""),
    ("[dynamics.start]\nz = -1", "dynamics.start.z: expected `float` >= 0", ""),
    ("[dynamics.vehicle]\nmass = 0", "dynamics.vehicle.mass: expected `float` >", ""),
    ("[supervise]\nanswer_timeout = 0.1", "supervise.answer_timeout: expected `float` >= 0.5", ""),
    ("[safety.separation]\nheight = 1e-200", "no distance can be computed for 1e-200 m", ""),
    ("[safety.separation]\nheight = 0.0099", "separation.height: ", "separation.radius = 0"),
    # Contradicting values.
    ("[pressure]\nprofile = 'bmp280'\nrate = 27", "rate 27 Hz: a bmp280 gives at most 26.3", ""),
    ("[pressure]\nprofile = 'ms5611'\nnoise = 0.1", "a ms5611 has its own", ""),
    ("[pressure]\nprofile = 'bmp581'", "pressure.profile: invalid enum value", ""),
    ("[pressure.fault]\nkind = 'broken'", "pressure.fault.kind: invalid enum value", ""),
    (
        "[pressure]\niio = 'iio:device0'",
        "pressure: iio: 'iio:device0' is not a full path",
        "",
    ),
    (
        "[pressure]\nsource = 'iio'\n[dynamics]\nspeed = 0",
        "it needs dynamics.speed 1 and dynamics.lockstep false",
        "",
    ),
    # Invalid TOML.
    ("[safety", "is not TOML", "line and column"),
    ("[safety]\ntakeoff = ", "is not TOML", "line and column"),
    ("[safety]\ntakeoff = 1\ntakeoff = 2", "is not TOML", ""),
    ("safety: {takeoff: 1}", "is not TOML", ""),
    ("[safety]\ntakeoff = 1,5", "is not TOML", ""),
    ("\0", "is not TOML", ""),
    # Huge numbers, deep nesting, endless keys.
    ("[safety]\ntakeoff = " + "9" * 900_000, "is not TOML", ""),
    ("[safety]\ntakeoff = 0x" + "f" * 900_000, "safety.takeoff: number out of range", ""),
    ("[safety]\ntakeoff = 1e" + "9" * 900_000, "safety.takeoff: expected `float` <= 10000", ""),
    ("a = " + "[" * 400_000 + "]" * 400_000, "is not TOML", ""),
    ("a = " + "{a=" * 200_000 + "1" + "}" * 200_000, "is not TOML", ""),
    ("[" + "a." * 400_000 + "a]", "a key of more than 50 parts", ""),
    ("a" + " . 'a,='" * 100_000 + " = 1", "a key of more than 50 parts", ""),
    ("[a]\n" + "b = " + "'" + "a." * 60, "a key of more than 50 parts", ""),
    ("takeoff = 1 #" + "." * 900_000, "unknown parameter takeoff", ""),
    ("takeoff = 1 #" + "a" * 900_000, "unknown parameter takeoff", ""),
    ("takeoff = 1 #." + " " * 900_000, "unknown parameter takeoff", ""),
]


def refused(file: Path) -> Invalid:
    with pytest.raises(Invalid) as caught:
        load(file)
    assert caught.value.exit_code == 6
    assert str(file) in caught.value.message
    assert caught.value.hint
    return caught.value


def test_at_least_forty_bad_files_are_covered():
    assert len(FILES) >= 40


@pytest.mark.parametrize(
    ("text", "message", "hint"), FILES, ids=[text[:60].replace("\n", " ") for text, _, _ in FILES]
)
def test_a_bad_file_is_refused_with_the_place_and_a_hint(
    tmp_path: Path, text: str, message: str, hint: str
):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    error = refused(file)
    assert message in error.message
    assert hint in error.hint


def test_a_missing_or_binary_file_is_refused(tmp_path: Path):
    assert "cannot be read: No such file" in refused(tmp_path / "none.toml").message
    assert "cannot be read: Is a directory" in refused(tmp_path).message
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert "is not a text" in refused(binary).message


@pytest.mark.parametrize(
    ("setting", "message", "hint"),
    [
        ("safety.takeoff", "no '='", "--set safety.virtual_cage.x=3"),
        ("safety.takeof=3", "unknown parameter safety.takeof", "did you mean safety.takeoff?"),
        ("/safety/takeof=3", "unknown parameter safety.takeof", "did you mean safety.takeoff?"),
        ("safety.takeoff=three", FLOAT, ""),
        ("safety.takeoff='3'", FLOAT, ""),
        ("safety.takeoff=", FLOAT, ""),
        ("safety.takeoff=nan", FLOAT, ""),
        ("safety.takeoff=-1", ">= 0", ""),
        ("safety.takeoff=1" + "0" * 400, "safety.takeoff", ""),
        ("safety.takeoff=" + "[" * 50_000, "safety.takeoff", ""),
        ("safety={" + "a." * 50_000 + "a=1}", TABLE, ""),
        ("safety.takeoff.x=3", "safety.takeoff", ""),
        ("safety=3", TABLE, ""),
        ("=3", "unknown parameter", ""),
        ("safety..takeoff=3", "unknown parameter", ""),
        ("safety.cage_on=1", "expected `bool`", ""),
        ("dynamics.rate=30", "1000 / rate", ""),
        ("safety.max_speed=5.7", "less than the vehicle may reach, 5.75 m/s", "a higher one"),
        ("safety.max_deceleration=4", "less than the vehicle may reach, 5 m/s^2", "a higher one"),
        ("safety.reaction=0.1", "describes an autopilot that is not ours", "[processes]"),
        ("safety.max_acceleration=1", "describes an autopilot that is not ours", "unproven"),
        ("safety.min_deceleration=9", "describes an autopilot that is not ours", "leave it out"),
    ],
)
def test_a_bad_setting_is_refused_with_its_name(setting: str, message: str, hint: str):
    with pytest.raises(Invalid) as caught:
        load(None, ["pressure.rate=20", setting])
    assert f"--set {setting}" in caught.value.message
    assert message in caught.value.message
    assert hint in caught.value.hint
    assert caught.value.hint


def test_a_set_into_a_value_of_the_file_names_the_setting(tmp_path: Path):
    file = tmp_path / "lab.toml"
    file.write_text("[safety]\ntakeoff = 1\n")
    with pytest.raises(Invalid, match=r"--set safety\.takeoff\.x=3: safety\.takeoff is a value"):
        load(file, ["safety.takeoff.x=3"])


def test_a_file_without_an_end_is_refused():
    with pytest.raises(Invalid, match="/dev/zero is too large: it has more than 1 MB"):
        read(Path("/dev/zero"))


def test_missing_file_is_reported_with_the_way_to_make_one(tmp_path: Path):
    with pytest.raises(Invalid, match="cannot be read: No such file") as raised:
        read(tmp_path / "none.toml")
    assert "quadctl init" in raised.value.hint
    with pytest.raises(Invalid) as raised:
        read(tmp_path / "none.toml", "write one")
    assert raised.value.hint == "write one"


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


def test_without_a_file_the_defaults_of_the_code_apply():
    params = load(None)
    assert params == Params()
    assert params.safety.virtual_cage == CageParams(5.0, 5.0, 5.0)
    assert params.safety.acceptance_range == 0.5


def test_file_overrides_defaults_and_set_overrides_the_file(file: Path):
    file.write_text("[safety]\ntakeoff = 2\nvirtual_cage = { x = 3, y = 3, z = 3 }\n")
    params = load(file, ["safety.virtual_cage.x=4"])
    assert params.safety == SafetyParams(takeoff=2.0, virtual_cage=CageParams(4.0, 3.0, 3.0))
    assert params.pressure == PressureParams()


def test_the_last_set_wins():
    assert load(None, ["pressure.rate=1", "pressure.rate=2"]).pressure.rate == 2.0


def test_running_values_override_defaults_and_set_overrides_them():
    running = Params(pressure=PressureParams(rate=20.0, noise=0.5))
    params = load(None, ["pressure.rate=30"], running)
    assert params.pressure == PressureParams(rate=30.0, noise=0.5)
    assert running.pressure.rate == 20.0


def test_a_given_file_replaces_the_running_systems_values(file: Path):
    file.write_text("[pressure]\nrate = 5\n")
    assert load(file, (), Params(pressure=PressureParams(noise=0.5))).pressure == PressureParams(
        rate=5.0
    )


def test_an_empty_file_gives_the_defaults(file: Path):
    file.write_text("")
    assert load(file) == Params()


def test_only_differences_of_further_vehicles_are_logged(file: Path):
    file.write_text("[safety]\nacceptance_range = 0.25\n")
    first, other = SafetyParams(), load(file).safety
    assert list(launch_lines(other, first)) == [
        "Launching with the first vehicle's parameters but for the following:",
        "Param: acceptance range - 0.25",
    ]
    assert list(launch_lines(other, other)) == []


def test_cage_and_range_in_the_file_change_the_logged_lines(file: Path):
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
def test_every_spelling_of_set_is_accepted(setting: str):
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


def test_words_and_lists_are_accepted_as_values():
    params = load(None, ["hub.transport=tcp", 'hub.listen=["tcp/127.0.0.1:7447"]'])
    assert params.hub.transport == "tcp"
    assert params.hub.listen == ["tcp/127.0.0.1:7447"]


def test_processes_accept_a_line_or_a_list(file: Path):
    file.write_text('[processes]\nsafety = "python my_safety.py"\nmine = ["sleep", "9"]\n')
    assert load(file).processes == {"safety": "python my_safety.py", "mine": ["sleep", "9"]}
    assert load(None, ["processes.mine=sleep 9"]).processes == {"mine": "sleep 9"}


@pytest.mark.parametrize(
    ("name", "normal"),
    [("/safety/virtual_cage/x", "safety.virtual_cage.x"), ("safety.takeoff", "safety.takeoff"),
     ("pressure/rate", "pressure.rate"), ("/safety/", "safety")],
)  # fmt: skip
def test_ros_style_names_are_accepted(name: str, normal: str):
    assert normal_name(name) == normal


@given(TABLES)
def test_a_flattened_table_can_be_rebuilt(table: dict[str, object]):
    built: dict[str, object] = {}
    for name, value in flatten(table):
        put(built, name, value, "here")
    assert built == table


def test_a_name_below_a_value_is_invalid():
    with pytest.raises(Invalid, match=r"--set x: safety\.takeoff is a value and has no x"):
        put({"safety": {"takeoff": 1.0}}, "safety.takeoff.x", 3, "--set x")


def test_a_value_in_the_place_of_a_table_is_invalid():
    table = {"safety": {"takeoff": {"x": 3}}}
    with pytest.raises(Invalid, match=r"safety\.takeoff: expected `object`, with x as before"):
        put(table, "safety.takeoff", 1.5, "--set x")
    assert table == {"safety": {"takeoff": {"x": 3}}}


@pytest.mark.parametrize("rate", [1000 / milliseconds for milliseconds in (1, 3, 7, 10, 40, 50)])
def test_a_timeout_lasts_until_the_next_setpoint_is_due(rate: float):
    stamps = [number / rate for number in range(1000)]
    answered = [stamp for stamp in stamps if SETPOINT.begins(stamp, 1 / rate)]
    longest = max(after - before for before, after in pairwise(answered))

    def given(timeout: float) -> list[str]:
        return [f"dynamics.rate={rate}", f"dynamics.setpoint_timeout={timeout}"]

    assert load(None, given(longest + 1e-9)).dynamics.setpoint_timeout > longest
    if longest > 0.0501:
        with pytest.raises(Invalid, match=r"is less than the time between two setpoints") as caught:
            load(None, given(longest - 1e-9))
        assert caught.value.hint == "a longer one, or another dynamics.rate"
        adapter = "processes.dynamics=my_autopilot"
        assert load(None, [adapter, *given(0.05)]).dynamics.setpoint_timeout == 0.05


def test_at_the_usual_rate_the_least_timeout_is_taken():
    assert load(None, ["dynamics.setpoint_timeout=0.05"]).dynamics.setpoint_timeout == 0.05


@pytest.mark.parametrize(
    "excused", ['processes.dynamics="python adapter.py"', "dynamics.unproven=true"]
)
def test_guards_of_a_vehicle_that_is_not_ours_have_any_value(excused: str):
    guards = ["max_speed=3", "max_deceleration=2", "reaction=0.3", "min_deceleration=1"]
    safety = load(None, [excused, *(f"safety.{each}" for each in guards)]).safety
    assert (safety.max_speed, safety.max_deceleration, safety.reaction) == (3, 2, 0.3)


@pytest.mark.parametrize(
    ("name", "meant"),
    [("virtual_cage", "virtual_cag"), ("rate", "rates"), ("transport", "Transport")],
)
def test_the_nearest_name_is_offered(name: str, meant: str):
    assert nearest(meant, ["virtual_cage", "rate", "transport"]) == f"did you mean {name}?"
    assert nearest("zzzzzz", ["virtual_cage", "rate"]) == ""


def test_checked_parameters_share_no_tables():
    one, other = check({}, "here"), check({}, "here")
    one.safety.virtual_cage.x = 1.0
    one.dynamics.start = StartParams(1.0)
    assert other == Params() == check({}, "here")
