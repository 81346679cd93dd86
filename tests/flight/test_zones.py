"""Zones of a running system: declared in its file, changed live, and around which goals are flown."""

from collections.abc import Iterator

import pytest

from tests.support.bare import Bare
from tests.support.lab import PATIENT, Lab, private_lab

TOWER = """
[[safety.zones]]
name = "tower"
polygon = [[1.0, -1.0], [2.0, -1.0], [2.0, 1.0], [1.0, 1.0]]
"""
POND = """
[[safety.zones]]
name = "pond"
circle = { x = -2.0, y = 0.0, radius = 1.0 }
ceiling = 1.5
"""


@pytest.fixture(scope="module")
def zoned() -> Iterator[Lab]:
    """System with one zone."""
    with private_lab() as made:
        (made.folder / "quad.toml").write_text(TOWER)
        made.share("--set", "dynamics.start.z=1", "--set", "dynamics.speed=4", *PATIENT)
        yield made


@pytest.fixture
def session(zoned: Lab) -> Iterator[Bare]:
    with zoned.put_back_session() as bare:
        yield bare


def test_zones_of_the_file_bar_ways_and_the_vehicle_flies_around_them(zoned: Lab, session: Bare):
    assert "inside the zone tower" in zoned.quadctl("goto", "1.5", "0", "1").err
    direct = zoned.quadctl("goto", "3", "0", "1", "--direct")
    assert (direct.code, "the way crosses the zone tower" in direct.err) == (5, True)
    states = session.watch("uav/safety/state")
    assert zoned.quadctl("goto", "3", "0", "1", "--settle").code == 0
    for leg in ((1, 3), (2, 3), (3, 3)):
        states.until(lambda s: (s["leg"], s["legs"]) == leg)  # noqa: B023 - called within the loop
    assert session.state()["goal"] == {"x": 3.0, "y": 0.0, "z": 1.0}
    wall = session.state()["nearest"]
    assert (wall["name"], wall["near"]) == ("tower", False)


def test_zones_are_added_and_removed_live_all_or_none(zoned: Lab, session: Bare):
    more = zoned.folder / "more.toml"
    more.write_text(POND)
    assert zoned.quadctl("zone", "add", str(more)).out == "added: pond\n"
    again = zoned.quadctl("zone", "add", str(more))
    assert (again.code, "two zones have the name pond" in again.err) == (6, True)
    listed = zoned.quadctl("zone", "list").out.splitlines()
    assert [line.split()[0] for line in listed] == ["NAME", "tower", "pond"]
    shown = zoned.quadctl("cage", "show", "--json").json["zones"]
    assert [zone["name"] for zone in shown] == ["tower", "pond"]
    # Kept by `param save`, and read again from its file.
    kept = zoned.folder / "kept.toml"
    for words in (("init", kept), ("param", "save", kept)):
        assert zoned.quadctl(*words).code == 0
    assert zoned.quadctl("zone", "remove", "tower", "nobody").code == 6
    assert zoned.quadctl("zone", "remove", "tower", "pond").code == 0
    assert zoned.quadctl("zone", "list", "--json").json == []
    assert zoned.quadctl("zone", "add", str(kept)).out == "added: tower, pond\n"
    assert zoned.quadctl("zone", "remove", "pond").code == 0


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "has no [[safety.zones]]"),
        ("zones = 3", "Expected `array`"),
        (TOWER + "hight = 3", "unknown field `hight`"),
        (POND.replace("1.0", "-1.0"), "radius"),
        ("[[safety", "is not TOML"),
    ],
)  # fmt: skip
def test_a_faulty_file_of_zones_changes_nothing(zoned: Lab, text: str, why: str):
    (zoned.folder / "bad.toml").write_text(text)
    before = zoned.quadctl("zone", "list").out
    done = zoned.quadctl("zone", "add", str(zoned.folder / "bad.toml"))
    assert (done.code, why in done.err) == (6, True)
    assert zoned.quadctl("zone", "list").out == before


def test_a_faulty_zone_in_the_file_starts_nothing(lab: Lab):
    (lab.folder / "quad.toml").write_text(TOWER.replace("1.0]]", "1.0], [1.0, -1.0]]"))
    done = lab.quadctl("up")
    assert done.code == 6
    assert "zone tower" in done.err
