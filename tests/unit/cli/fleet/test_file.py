"""Fleet file: vehicles, hubs and formations, and the errors of an invalid file."""

import tomllib
from pathlib import Path

import pytest

from quadctl.cli.fleet.file import Member, fleet_of, read
from quadctl.schemas.messages import Position
from quadctl.services.runtime.errors import Invalid

EXAMPLE = Path(__file__).parents[4] / "examples" / "fleet.toml"
WHOLE = """
[vehicles]
uav0 = {}
red = { connect = "tls/lab2:7447", vehicle = "uav" }
[formations.line]
uav0 = [-1.0, 0, 0.5]
red = [1.0, 0.0, 0.0]
"""


def fleet(text: str, connect: str = ""):
    return fleet_of(tomllib.loads(text), "f.toml", connect)


def test_the_file_gives_each_vehicles_hub_and_formation():
    assert fleet(WHOLE).members == [
        Member("uav0", "", "uav0"),
        Member("red", "tls/lab2:7447", "uav"),
    ]
    assert fleet(WHOLE, "tcp/hub:7447").members[0] == Member("uav0", "tcp/hub:7447", "uav0")
    assert fleet(WHOLE).formations == {
        "line": {"uav0": Position(-1.0, 0.0, 0.5), "red": Position(1.0, 0.0, 0.0)}
    }


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("", "f.toml: object missing required field `vehicles`", "[vehicles]"),
        ("[vehicles]", "f.toml: it names no vehicle", "uav0 = {}"),
        ("[vehicles]\na = 3", "f.toml: vehicles.a: expected `object`", "a vehicle is written as"),
        ('[vehicles]\na = { conect = "x" }', "vehicles.a: object contains unknown field `conect`",
         "connect ="),
        ('[vehicles]\n"a/b" = {}', "vehicles.a/b: 'a/b' is not a valid name for a vehicle", "letters"),
        ('[vehicles]\na = { vehicle = "b" }\nb = {}', "vehicles.b is the same vehicle as a",
         "another `connect`"),
        ("[vehicles]\na = {}\n[formations.f]\nb = [0, 0, 0]", "formations.f: there is no vehicle b",
         "the vehicles are a"),
        ("[vehicles]\na = {}\n[formations.f]\na = [0, 0]", "formations.f.a: ", "metres"),
        ("[vehicles]\na = {}\n[formations.f]\na = [0, 0, nan]", "formations.f.a: z = nan: expected",
         "metres"),
        ('[vehicles]\na = {}\n[formations.f]\na = [0, "x", 1]', 'formations.f.a: y = "x": expected',
         "metres"),
        ("[vehicles]\na = {}\n[formations.f]\na = 3", "formations.f.a: 3 is not a point", "metres"),
        ("[vehicles]\na = {}\nb = {}\n[formations.f]\na = [0, 0, 1]\nb = [-0.0, 0, 1.0]",
         "formations.f: b has the same place as a", "collide"),
        ('[vehicles]\na = { connect = "garbage" }', "vehicles.a.connect: 'garbage' is not an endpoint",
         "PROTOCOL/ADDRESS"),
        ("[vehicles]\na = {}\n[formation.f]\na = [0, 0, 1]", "unknown field `formation`",
         "[formations.NAME]"),
    ],
)  # fmt: skip
def test_an_invalid_file_names_the_wrong_entry(text: str, message: str, hint: str):
    with pytest.raises(Invalid) as raised:
        fleet(text)
    assert message in raised.value.message
    assert hint in raised.value.hint


def test_a_missing_file_is_an_error_with_an_example(tmp_path: Path):
    with pytest.raises(Invalid) as raised:
        read(tmp_path / "none.toml", "")
    assert "[vehicles]" in raised.value.hint
    assert "init" not in raised.value.hint


def test_the_example_is_a_valid_fleet_file():
    found = read(EXAMPLE, "")
    assert [member.name for member in found.members] == ["uav0", "uav1"]
    assert set(found.formations) == {"line", "stairs"}
