"""Commands on a recording, without a running system."""

import csv
from pathlib import Path

import pytest

from tests.support.bags import BEGAN, SECOND, flight, pose, raw_message, refused, write
from tests.support.command_line import Quadctl

FLOWN = Path(__file__).parents[2] / "recording" / "data" / "cage.mcap"


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write(
        tmp_path / "f.mcap", [*flight(100), raw_message("uav/@call/goto", refused(9, 0, 1), 1)]
    )


def test_info_lists_the_contents(quadctl: Quadctl, bag: Path):
    result = quadctl("bag", "info", "f.mcap", "--json").json
    assert (result["ok"], result["messages"], result["cut"]) == (True, 122, "")
    assert (result["begin"], result["seconds"]) == (BEGAN / SECOND, 1.0)
    keys = {row["key"]: row for row in result["keys"]}
    assert keys["uav/pose"] == {
        "key": "uav/pose", "type": "Pose", "encoding": keys["uav/pose"]["encoding"],
        "messages": 100, "hz": 99.0, "derived": False,
    }  # fmt: skip
    assert (keys["my/own"]["type"], keys["my/own"]["encoding"]) == ("", "zenoh/bytes")
    lines = quadctl("bag", "info", "f.mcap").out.splitlines()
    assert lines[0].split() == ["File:", "f.mcap"]
    assert ["uav/pose", "Pose", "100", "99.0"] in [line.split() for line in lines]


def test_a_truncated_recording_is_reported_and_repaired(quadctl: Quadctl, bag: Path):
    bag.write_bytes(bag.read_bytes()[:-100])
    assert quadctl("bag", "info", "f.mcap").err.startswith("it is cut: ")
    checked = quadctl("bag", "check", "f.mcap", "--json")
    assert (checked.code, checked.json["ok"]) == (8, False)
    assert checked.json["faults"][0].startswith("it is cut: ")
    beside = quadctl("bag", "repair", "f.mcap", "-o", "g.mcap", "--json").json
    assert (beside["file"], beside["messages"]) == ("g.mcap", 122)
    assert quadctl("bag", "check", "g.mcap") == (
        0,
        "g.mcap: 122 messages, no faults\n",
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
    ("file", "text"), [("none.mcap", "cannot be read"), ("text.mcap", "is not a recording")]
)
def test_a_file_that_is_no_recording_is_rejected(
    quadctl: Quadctl, tmp_path: Path, words: str, file: str, text: str
):
    (tmp_path / "text.mcap").write_text("a text, and no recording")
    result = quadctl(*words.split(), file, "--json")
    assert (result.code, result.error["code"]) == (6, "invalid")
    assert text in result.error["message"]


def test_each_key_is_exported_as_a_table_without_rounding(quadctl: Quadctl, bag: Path):
    result = quadctl("bag", "export", "f.mcap", "--csv", "--json").json
    rows = {row["key"]: row for row in result["tables"]}
    assert rows["uav/pose"] == {"key": "uav/pose", "file": "f/uav.pose.csv", "rows": 100}
    assert "my/own" not in rows, "a payload without fields has no table"
    with Path("f/uav.pose.csv").open(encoding="utf-8", newline="") as file:
        poses = list(csv.DictReader(file))
    assert list(poses[3])[:6] == ["unix_time", "boot", "seq", "stamp", "position.x", "position.y"]
    assert float(poses[3]["position.x"]) == pose(3).position.x
    assert poses[3]["unix_time"] == f"{BEGAN // SECOND}.030000000"
    assert quadctl("bag", "export", "f.mcap", "--csv").code == 6
    assert quadctl("bag", "export", "f.mcap").code == 2
    assert quadctl("bag", "export", "f.mcap", "--csv", "-o", "other").code == 0


@pytest.mark.thorough
def test_a_flight_is_drawn(quadctl: Quadctl, tmp_path: Path):
    result = quadctl("plot", FLOWN, "-o", "flight.svg", "--json")
    assert result.code == 0
    assert result.json["vehicles"] == ["uav"]
    assert result.json["seconds"] > 14
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
def test_invalid_arguments_are_rejected(quadctl: Quadctl, words: str, code: int):
    result = quadctl(*words.split(), "--json")
    assert result.code == code
    assert result.error["hint"]


def test_a_recording_without_poses_is_not_plotted(quadctl: Quadctl, tmp_path: Path):
    write(tmp_path / "none.mcap", [raw_message("my/own", b"x", 0, "text/plain")])
    result = quadctl("plot", "none.mcap")
    assert (result.code, result.out) == (6, "")
    assert result.err.startswith("error: nothing to draw: no pose arrived")
