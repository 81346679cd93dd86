"""Commands on a recording, without a running system."""

import csv
from pathlib import Path

import msgspec
import pytest
from mcap.writer import Writer

from quadctl.services.runtime.recording.framing import summary
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


def test_tables_are_overwritten_only_by_force(quadctl: Quadctl, bag: Path):
    words = ("bag", "export", "f.mcap", "--csv")
    assert quadctl(*words).code == 0
    table = Path("f/uav.pose.csv")
    table.write_text("mine")
    refused = quadctl(*words)
    assert (refused.code, refused.out) == (6, "")
    assert ".csv already exists" in refused.err
    assert "--force" in refused.err
    assert table.read_text() == "mine"
    assert quadctl(*words, "--force").code == 0
    assert table.read_text().count("\n") == 101


KEYS = [
    "/a/b", "a/b", "/a.b", "a.b", "A/b", ".hidden", "..", "a b", "a%2Fb", "con:x", "x" * 300, "x" * 301,
    "été/@srv/é", "a\\b", "a/b~2",
]  # fmt: skip


def test_every_key_has_a_table_of_its_own_that_is_seen(quadctl: Quadctl, tmp_path: Path):
    sent = [raw_message(key, {"n": n}, n, "application/json") for n, key in enumerate(KEYS)]
    write(tmp_path / "keys.mcap", sent)
    tables = quadctl("bag", "export", "keys.mcap", "--csv", "--json").json["tables"]
    assert [table["key"] for table in tables] == KEYS
    names = [Path(table["file"]).name for table in tables]
    assert len({name.casefold() for name in names}) == len(KEYS)
    assert not [name for name in names if name.startswith(".") or set(name) & set('\\:*?"<>|')]
    assert names[:4] == ["%2Fa.b.csv", "a.b.csv", "%2Fa%2Eb.csv", "a%2Eb.csv"]
    for number, name in enumerate(names):
        assert Path("keys", name).read_text().splitlines()[1].endswith(f",{number}")


def foreign(path: Path, *encodings: str) -> Path:
    with path.open("wb") as out:
        mcap = Writer(out)
        mcap.start("ros2", "another program")
        schema = mcap.register_schema("std_msgs/msg/Empty", "ros2msg", b"")
        for number, encoding in enumerate(encodings):
            channel = mcap.register_channel(f"/{encoding}", encoding, schema)
            mcap.add_message(channel, number, b'{"a":1}', number)
        mcap.finish()
    return path


def test_what_makes_no_table_is_named(quadctl: Quadctl, tmp_path: Path):
    foreign(tmp_path / "ros2.mcap", "cdr")
    refused = quadctl("bag", "export", "ros2.mcap", "--csv")
    assert (refused.code, refused.out) == (6, "")
    assert "nothing that makes a table: 1 messages on /cdr" in refused.err
    assert not Path("ros2").exists()
    foreign(tmp_path / "both.mcap", "cdr", "json")
    done = quadctl("bag", "export", "both.mcap", "--csv")
    assert done.code == 0
    assert "no tables: 1 messages on /cdr" in done.err
    checked = quadctl("bag", "check", "ros2.mcap")
    assert "1 messages are encoded as cdr: not checked" in checked.out
    assert quadctl("bag", "check", "ros2.mcap", "--json").json["unchecked"] == {"cdr": 1}


IN_CHUNK = 25


@pytest.mark.parametrize("encoding", ["#a9099889", "", "#ffffffff"])
def test_a_type_that_only_its_publisher_knows_is_shown_by_its_name(
    quadctl: Quadctl, tmp_path: Path, encoding: str
):
    battery = msgspec.msgpack.encode({"volt": 3.7})
    encoding = f"application/msgpack;quadctl.Battery{encoding}"
    write(tmp_path / "own.mcap", [raw_message("uav/own/battery", battery, 0.1, encoding)])
    shown = quadctl("bag", "info", "own.mcap").out
    assert "Battery  " in shown
    assert "application/" not in shown
    (key,) = quadctl("bag", "info", "own.mcap", "--json").json["keys"]
    assert (key["type"], key["encoding"]) == ("Battery", encoding)


READERS = ["bag info", "bag check", "bag export --csv", "plot -o new.svg", "bag repair -o new.mcap"]


@pytest.mark.parametrize("chunk", [0, 2, 4])
@pytest.mark.parametrize("line", READERS)
def test_every_reader_skips_a_damaged_chunk_and_reports_it(
    quadctl: Quadctl, bag: Path, chunk: int, line: str
):
    index = summary(bag)
    assert index is not None
    data = bytearray(bag.read_bytes())
    place = index.chunk_indexes[chunk].chunk_start_offset
    data[place + 200] ^= 1
    bag.write_bytes(data)
    done = quadctl(*line.split(), "f.mcap")
    assert done.code == (8 if line == "bag check" else 0)
    text = done.out + done.err
    assert f"damaged in one place, where {index.chunk_indexes[chunk].chunk_length} bytes" in text
    assert f"the first at byte {place}: " in text
    assert bag.read_bytes() == data
    left = 122 - (IN_CHUNK if chunk < 4 else 22)
    if line == "bag info":
        found = quadctl("bag", "info", "f.mcap", "--json").json
        assert (found["messages"], found["missing"], found["ok"]) == (left, 122 - left, False)
    elif line == "bag check":
        assert f"{left} messages, faulty" in done.out


@pytest.mark.thorough
def test_a_flight_is_drawn(quadctl: Quadctl, tmp_path: Path):
    result = quadctl("plot", FLOWN, "-o", "flight.svg", "--json")
    assert result.code == 0
    assert result.json["vehicles"] == ["uav"]
    assert result.json["seconds"] > 14
    text = (tmp_path / "flight.svg").read_text()
    assert "path from above" in text or "<svg" in text
    refused = quadctl("plot", FLOWN, "-o", "flight.svg")
    assert (refused.code, refused.out) == (6, "")
    assert "flight.svg already exists" in refused.err
    assert (tmp_path / "flight.svg").read_text() == text
    assert quadctl("plot", FLOWN, "-o", "flight.svg", "--force").code == 0


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("plot", 2),
        (f"plot {FLOWN} --live", 2),
        (f"plot {FLOWN} -o flight.jpg", 6),
        (f"plot {FLOWN} -o no/such/folder/f.png", 6),
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
    assert result.err.startswith("error: nothing to draw: there is no pose in it")


def test_a_recording_without_a_message_is_repaired_and_read(quadctl: Quadctl, bag: Path):
    empty = bag.with_name("empty.mcap")
    empty.write_bytes(bag.read_bytes()[:60])
    assert "0 messages kept" in quadctl("bag", "repair", "empty.mcap").out
    assert quadctl("bag", "check", "empty.mcap") == (0, "empty.mcap: 0 messages, no faults\n", "")
    info = quadctl("bag", "info", "empty.mcap")
    assert (info.code, info.err) == (0, "")


@pytest.mark.parametrize("line", ["bag repair f.mcap -o f.mcap", "plot f.mcap -o f.png"])
def test_a_command_never_writes_over_a_file(quadctl: Quadctl, bag: Path, line: str):
    bag.with_name("f.png").write_bytes(b"mine")
    before = bag.read_bytes()
    assert quadctl(*line.split()).code == 6
    assert (bag.read_bytes(), bag.with_name("f.png").read_bytes()) == (before, b"mine")
