"""Commands that work on a recording alone, and need no running system."""

import csv
from pathlib import Path

import pytest

from tests.support.bags import BEGAN, SECOND, flight, pose, refused, taken, write
from tests.support.command_line import Quadctl

FLOWN = Path(__file__).parents[2] / "recording" / "data" / "cage.mcap"


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write(tmp_path / "f.mcap", [*flight(100), taken("uav/@call/goto", refused(9, 0, 1), 1)])


def test_info_says_what_is_in_it(quadctl: Quadctl, bag: Path):
    said = quadctl("bag", "info", "f.mcap", "--json").json
    assert (said["ok"], said["messages"], said["cut"]) == (True, 122, "")
    assert (said["begin"], said["seconds"]) == (BEGAN / SECOND, 1.0)
    keys = {row["key"]: row for row in said["keys"]}
    assert keys["uav/pose"] == {
        "key": "uav/pose", "type": "Pose", "encoding": keys["uav/pose"]["encoding"],
        "messages": 100, "hz": 99.0, "derived": False,
    }  # fmt: skip
    assert (keys["my/own"]["type"], keys["my/own"]["encoding"]) == ("", "zenoh/bytes")
    lines = quadctl("bag", "info", "f.mcap").out.splitlines()
    assert lines[0].split() == ["File:", "f.mcap"]
    assert ["uav/pose", "Pose", "100", "99.0"] in [line.split() for line in lines]


def test_a_cut_one_is_told_checked_and_mended(quadctl: Quadctl, bag: Path):
    bag.write_bytes(bag.read_bytes()[:-100])
    assert quadctl("bag", "info", "f.mcap").err.startswith("it is cut: ")
    checked = quadctl("bag", "check", "f.mcap", "--json")
    assert (checked.code, checked.json["ok"]) == (8, False)
    assert checked.json["faults"][0].startswith("it is cut: ")
    beside = quadctl("bag", "repair", "f.mcap", "-o", "g.mcap", "--json").json
    assert (beside["file"], beside["messages"]) == ("g.mcap", 122)
    assert quadctl("bag", "check", "g.mcap") == (
        0,
        "g.mcap: 122 messages, whole and right\n",
        "",
    )
    assert quadctl("bag", "check", "f.mcap").code == 8
    assert quadctl("bag", "repair", "f.mcap").out.startswith("f.mcap: 122 messages kept, ")
    assert quadctl("bag", "repair", "f.mcap").out == "f.mcap was whole: 122 messages\n"
    assert quadctl("bag", "repair", "f.mcap", "-o", "g.mcap").code == 6
    assert sorted(path.name for path in bag.parent.glob("*mcap*")) == ["f.mcap", "g.mcap"]


@pytest.mark.parametrize(
    "words", ["bag info", "bag check", "bag repair", "bag export --csv", "plot", "replay"]
)
@pytest.mark.parametrize(
    ("file", "text"), [("none.mcap", "cannot be read"), ("text.mcap", "is no recording")]
)
def test_what_is_no_recording(quadctl: Quadctl, tmp_path: Path, words: str, file: str, text: str):
    (tmp_path / "text.mcap").write_text("a text, and no recording")
    said = quadctl(*words.split(), file, "--json")
    assert (said.code, said.error["code"]) == (6, "invalid")
    assert text in said.error["message"]


def test_a_table_for_each_key_whose_numbers_read_back_the_same(quadctl: Quadctl, bag: Path):
    said = quadctl("bag", "export", "f.mcap", "--csv", "--json").json
    rows = {row["key"]: row for row in said["tables"]}
    assert rows["uav/pose"] == {"key": "uav/pose", "file": "f/uav.pose.csv", "rows": 100}
    assert "my/own" not in rows, "what has no fields is no table"
    with Path("f/uav.pose.csv").open(encoding="utf-8", newline="") as file:
        poses = list(csv.DictReader(file))
    assert list(poses[3])[:6] == ["unix_time", "boot", "seq", "stamp", "position.x", "position.y"]
    assert float(poses[3]["position.x"]) == pose(3).position.x
    assert poses[3]["unix_time"] == f"{BEGAN // SECOND}.030000000"
    assert quadctl("bag", "export", "f.mcap", "--csv").code == 6
    assert quadctl("bag", "export", "f.mcap").code == 2
    assert quadctl("bag", "export", "f.mcap", "--csv", "-o", "other").code == 0


def test_a_flight_is_drawn(quadctl: Quadctl, tmp_path: Path):
    said = quadctl("plot", FLOWN, "-o", "flight.svg", "--json")
    assert said.code == 0
    assert said.json["vehicles"] == ["uav"]
    assert said.json["seconds"] > 14
    text = (tmp_path / "flight.svg").read_text()
    assert "path from above" in text or "<svg" in text


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("plot", 2),
        (f"plot {FLOWN} --live", 2),
        (f"plot {FLOWN} -o flight.jpg", 6),
        (f"plot {FLOWN} -o no/such/folder/f.png", 1),
        ("plot --live --duration 0", 6),
        ("record --duration 0", 6),
        ("record a//b", 6),
    ],
)
def test_what_cannot_be(quadctl: Quadctl, words: str, code: int):
    said = quadctl(*words.split(), "--json")
    assert said.code == code
    assert said.error["hint"]


def test_of_a_recording_without_a_pose_there_is_no_picture(quadctl: Quadctl, tmp_path: Path):
    write(tmp_path / "none.mcap", [taken("my/own", b"x", 0, "text/plain")])
    said = quadctl("plot", "none.mcap")
    assert (said.code, said.out) == (6, "")
    assert said.err.startswith("error: there is nothing to draw: no pose came")
