"""Parameter files and settings that cannot be: what is wrong, where, and what was meant."""

from pathlib import Path

import pytest

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.params.load import load, read

FLOAT, TABLE = "expected `float`", "expected `object`"
# The file, what the error must name, and what its hint must offer.
FILES = [
    # Names that are not there.
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
    # Types that are wrong.
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
    # Numbers that cannot be.
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
    # What does not go together.
    ("[pressure]\nprofile = 'bmp280'\nrate = 27", "rate 27 Hz: a bmp280 gives at most 26.3", ""),
    ("[pressure]\nprofile = 'ms5611'\nnoise = 0.1", "a ms5611 has noise of its own", ""),
    ("[pressure]\nprofile = 'bmp581'", "pressure.profile: invalid enum value", ""),
    ("[pressure.fault]\nkind = 'broken'", "pressure.fault.kind: invalid enum value", ""),
    (
        "[pressure]\niio = 'iio:device0'",
        "pressure: iio: 'iio:device0' is no folder's full path",
        "",
    ),
    ("[pressure]\nsource = 'iio'\n[dynamics]\nspeed = 0", "needs dynamics.speed 1, not 0", ""),
    # What is no TOML.
    ("[safety", "is not TOML", "line and column"),
    ("[safety]\ntakeoff = ", "is not TOML", "line and column"),
    ("[safety]\ntakeoff = 1\ntakeoff = 2", "is not TOML", ""),
    ("safety: {takeoff: 1}", "is not TOML", ""),
    ("[safety]\ntakeoff = 1,5", "is not TOML", ""),
    ("\0", "is not TOML", ""),
]


def refused(file: Path) -> Invalid:
    with pytest.raises(Invalid) as caught:
        load(file)
    assert caught.value.exit_code == 6
    assert str(file) in caught.value.message
    assert caught.value.hint
    return caught.value


def test_there_are_forty_of_them():
    assert len(FILES) >= 40


@pytest.mark.parametrize(
    ("text", "named", "offered"), FILES, ids=[text.replace("\n", " ") for text, _, _ in FILES]
)
def test_a_bad_file_is_refused_with_the_place_and_the_way_out(
    tmp_path: Path, text: str, named: str, offered: str
):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    error = refused(file)
    assert named in error.message
    assert offered in error.hint


def test_a_file_that_is_not_there_or_no_file_or_no_text(tmp_path: Path):
    assert "cannot be read: No such file" in refused(tmp_path / "none.toml").message
    assert "cannot be read: Is a directory" in refused(tmp_path).message
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert "is not TOML" in refused(binary).message


@pytest.mark.parametrize(
    ("setting", "named", "offered"),
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
        ("safety.takeoff.x=3", "safety.takeoff", ""),
        ("safety=3", TABLE, ""),
        ("=3", "unknown parameter", ""),
        ("safety..takeoff=3", "unknown parameter", ""),
        ("safety.cage_on=1", "expected `bool`", ""),
        ("dynamics.rate=30", "1000 / rate", ""),
    ],
)
def test_a_bad_setting_is_refused_by_name(setting: str, named: str, offered: str):
    with pytest.raises(Invalid) as caught:
        load(None, ["pressure.rate=20", setting])
    assert f"--set {setting}" in caught.value.message
    assert named in caught.value.message
    assert offered in caught.value.hint
    assert caught.value.hint


def test_a_set_into_a_value_of_the_file_names_the_setting(tmp_path: Path):
    file = tmp_path / "lab.toml"
    file.write_text("[safety]\ntakeoff = 1\n")
    with pytest.raises(Invalid, match=r"--set safety\.takeoff\.x=3: safety\.takeoff is a value"):
        load(file, ["safety.takeoff.x=3"])


def test_a_file_without_an_end_is_refused():
    with pytest.raises(Invalid, match="/dev/zero is no such file: it has more than 1 MB"):
        read(Path("/dev/zero"))


def test_a_file_that_is_not_there_is_told_with_where_one_comes_from(tmp_path: Path):
    with pytest.raises(Invalid, match="cannot be read: No such file") as raised:
        read(tmp_path / "none.toml")
    assert "quadctl init" in raised.value.hint
    with pytest.raises(Invalid) as raised:
        read(tmp_path / "none.toml", "write one")
    assert raised.value.hint == "write one"
