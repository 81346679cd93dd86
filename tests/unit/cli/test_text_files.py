"""Texts of any editor: byte order marks, UTF-16, UTF-32 and CRLF, in every file that a command reads."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, strategies as st

from quadctl.cli.fleet import file as fleet_file
from quadctl.cli.lab.handin import nodes_in
from quadctl.cli.lab.rubric import rubric
from quadctl.cli.mission.mission import mission
from quadctl.cli.zone import zones_of
from quadctl.services.runtime.files import Text, read_text
from quadctl.services.runtime.params.load import load, load_vehicles, read
from tests.support.command_line import Quadctl

ROOT = Path(__file__).parents[3]
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"]
ZONE = """\
# Türme
[[safety.zones]]
name = "tower"
kind = "exclusion"
circle = { x = 1.0, y = 1.0, radius = 0.5 }
"""
LAB = ROOT / "cli" / "lab"


def example(name: str) -> str:
    return (ROOT / "examples" / name).read_text(encoding="utf-8")


READERS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "parameters": (load, example("crazyflie.toml")),
    "vehicles": (
        lambda file: load_vehicles(file, vehicles=["uav0", "uav1"]),
        "[uav1.safety]\ntakeoff = 1.5 # höher\n",
    ),
    "mission": (lambda file: mission(read(file), "it"), example("mission.toml")),
    "fleet": (lambda file: fleet_file.fleet_of(read(file), "it", ""), example("fleet.toml")),
    "zones": (zones_of, ZONE),
    "rubric": (
        lambda file: rubric(read(file), "it"),
        (LAB / "rubric.toml").read_text(encoding="utf-8"),
    ),
    "hand-in": (
        lambda file: nodes_in(file.rename(file.with_name("quad.toml")).parent),
        '[processes]\nsafety = "python3 mine.py" # meine\n',
    ),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("reader", READERS)
def test_a_file_means_the_same_in_each_encoding(
    reader: str, ends: str, encoding: str, tmp_path: Path
):
    reads, text = READERS[reader]
    (tmp_path / "mine.py").write_text("")
    plain, file = tmp_path / "plain.toml", tmp_path / "file.toml"
    plain.write_bytes(text.encode())
    expected = reads(plain)
    file.write_bytes(text.replace("\n", ends).encode(encoding))
    assert reads(file) == expected


TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30).map("# ".__add__)


@given(TEXTS, TEXTS, st.sampled_from(ENCODINGS))
def test_a_text_written_back_keeps_its_encoding(before: str, after: str, encoding: str):
    with TemporaryDirectory() as folder:
        file = Path(folder, "text.toml")
        file.write_bytes(before.encode(encoding))
        found = read_text(file, "")
        assert found.text == before
        assert found.encoded(before) == before.encode(encoding)
        file.write_bytes(found.encoded(after))
        again = read_text(file, "")
        assert (again.encoding, again.mark) == (found.encoding, found.mark)


def test_a_text_written_back_keeps_its_line_ends():
    found = Text("a = 1\r\nb = 2\r\n", "utf-8", b"")
    assert found.encoded("a = 1\r\nb = 3\n\n[c]\n") == b"a = 1\r\nb = 3\r\n\r\n[c]\r\n"
    mixed = Text("a = 1\r\nb = 2\n", "utf-8", b"")
    assert mixed.encoded("a = 1\r\nb = 3\n") == b"a = 1\r\nb = 3\n"


@pytest.mark.parametrize(
    ("data", "message", "hint"),
    [
        ("a = 'é'".encode("latin-1"), "is not a text", "UTF-8"),
        (b"\xff\xfea", "is not a text", "UTF-8"),
        (b"\0\0\0\0", "is not TOML", "line and column"),
        (b"a = .5", "is not TOML", "0.5"),
        (b"a = [1.0, 5.]", "is not TOML", "5.0"),
    ],
)
def test_any_other_file_is_refused_with_the_remedy(
    data: bytes, message: str, hint: str, quadctl: Quadctl, tmp_path: Path
):
    (tmp_path / "quad.toml").write_bytes(data)
    result = quadctl("up", "quad.toml", "--json")
    assert result.code == 6
    assert message in result.error["message"]
    assert hint in result.error["hint"]


def test_a_mission_of_any_encoding_is_suggested(quadctl: Quadctl, tmp_path: Path):
    (tmp_path / "flight.toml").write_bytes(example("mission.toml").encode("utf-16"))
    result = quadctl("fly", "none.toml", "--json")
    assert "flight.toml" in result.error["hint"]
