"""Hand-ins: all that students pack them with is taken, and whatever is damaged or hostile has one line."""

import errno
import gzip
import lzma
import os
import random
import socket
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from quadctl.cli.lab import archives, handin
from quadctl.cli.lab.handin import HandIn, encodable, nodes_in, unpacked
from quadctl.services.runtime.errors import Invalid
from tests.support.archives import (
    LAB,
    below,
    flipped,
    folder,
    replaced,
    special,
    tarred,
    zipped,
    zipped_link,
)

SOURCE, SAFETY, PRESSURE = (
    LAB["my_safety.py"],
    ["python", "my_safety.py"],
    ["python", "my_pressure.py"],
)
JUNK = {
    "__MACOSX/._my_safety.py": b"x", "._my_safety.py": b"x", ".DS_Store": b"x", "__pycache__/a.pyc": b"x",
    ".venv/big": bytes(2000), "env/pyvenv.cfg": b"x", "env/big": bytes(2000), ".git/HEAD": b"x", ".idea/x": b"x",
    "node_modules/x/y": bytes(2000), ".vscode/x": b"x", "flight.mcap": bytes(2000),
}  # fmt: skip


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the limits small, so that what exceeds them is small too."""
    monkeypatch.setattr(archives, "_MOST_ENTRIES", 100)
    monkeypatch.setattr(archives, "_MOST_READ", 1 << 20)
    monkeypatch.setattr(archives, "_MOST_DIRECTORY", 20_000)
    monkeypatch.setattr(handin, "_MOST_FILES", 12)
    monkeypatch.setattr(handin, "_MOST_BYTES", 10_000)


def copied(path: Path, own: Path, members: dict[str, str] | None = None) -> Path:
    own.mkdir()
    return unpacked(HandIn("anna", path, members), own)


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def header(kind: bytes, size: int) -> bytes:
    """Return a header of a tar file with as many bytes of zeros."""
    info = special(kind)
    info.size = size
    return info.tobuf(tarfile.USTAR_FORMAT) + bytes(size + -size % 512)


def encoded(text: bytes, encoding: str) -> bytes:
    return text.decode().encode(encoding)


TAKEN: dict[str, tuple[str, bytes]] = {
    "zip": ("a.zip", zipped()),
    "zip with a folder": ("a.zip", zipped(below("mylab"))),
    "zip under another name": ("a.dat", zipped()),
    "zip after other bytes": ("a.zip", b"#!/bin/sh\n" + zipped()),
    "stored zip": ("a.zip", zipped(method=zipfile.ZIP_STORED)),
    "PowerShell": ("a.zip", zipped({"lab\\": b""} | {f"lab\\{n}": d for n, d in LAB.items()})),
    "byte order marks": ("a.zip", zipped({f"\ufeff{name}": data for name, data in LAB.items()})),
    "UTF-8": ("a.zip", zipped(below("Übung"))),
    "macOS": ("a.zip", zipped(LAB | JUNK)),
    "Moodle": ("a.zip", zipped({"Anna Ö_12345_assignsubmission_file_/work.zip": zipped(below("mylab"))})),
    "zip in zip in zip": ("a.zip", zipped({"b.zip": zipped({"c.tgz": tarred(mode="w:gz")})})),
    "tar": ("a.tar", tarred()),
    "tar from its own folder": ("a.tar", tarred(below("."), others=[special(tarfile.DIRTYPE, ".")])),
    "tar.gz": ("a.tar.gz", tarred(below("mylab"), "w:gz")),
    "tgz": ("a.tgz", tarred(LAB | JUNK, "w:gz")),
    "tar.xz": ("a.tar.xz", tarred(mode="w:xz")),
    "tar.bz2": ("a.tar.bz2", tarred(mode="w:bz2")),
    "link in a zip": ("a.zip", zipped_link("also.py", "my_safety.py")),
    "link in a tar": ("a.tar", tarred(others=[special(tarfile.SYMTYPE, "also.py", "my_safety.py")])),
    "one file": ("my_safety.py", SOURCE),
    "one file in a zip": ("a.zip", zipped({"my_safety.py": SOURCE})),
    "a copy further in": ("a.zip", zipped(LAB | below("old"))),
    "another quad.toml further in": ("a.zip", zipped({"my_safety.py": SOURCE} | below("old", LAB | {"my_safety.py": b""}))),
    "a node beside it": ("a.zip", zipped(below("lab") | {"old/my_safety.py": b""})),
    "environment around a lab": ("a.zip", zipped(below("lab", LAB | {"pyvenv.cfg": b""}))),
}  # fmt: skip


@pytest.mark.parametrize("name", TAKEN)
def test_a_file_is_taken(name: str, tmp_path: Path):
    file, data = TAKEN[name]
    copy = copied(written(tmp_path / file, data), tmp_path / "own")
    assert (copy / "my_safety.py").read_bytes() == SOURCE
    assert nodes_in(copy) == {"safety": SAFETY}
    assert not {path.name for path in copy.rglob("*")} & {name.split("/")[0] for name in JUNK}


def test_a_folder_is_taken_with_links_to_its_own_files_and_without_its_junk(tmp_path: Path):
    own = folder(tmp_path / "anna", LAB | JUNK | {"lib/run.sh": b"exit"})
    (own / "lib/run.sh").chmod(0o755)
    (own / "near.py").symlink_to("lib/../my_safety.py")
    (own / "absolute.py").symlink_to(own / "my_safety.py")
    copy = copied(own, tmp_path / "own")
    assert {path.name for path in copy.iterdir()} == {*LAB, "lib", "near.py", "absolute.py"}
    assert os.access(copy / "lib/run.sh", os.X_OK)
    for name in ("near.py", "absolute.py"):
        assert (copy / name).resolve() == (copy / "my_safety.py").resolve()


@pytest.mark.parametrize(
    "data",
    [
        encoded(LAB["quad.toml"], "utf-8-sig"), encoded(LAB["quad.toml"], "utf-16"),
        b"\xfe\xff" + encoded(LAB["quad.toml"], "utf-16-be"), LAB["quad.toml"].replace(b"\n", b"\r\n"),
    ],
)  # fmt: skip
def test_quad_toml_may_be_in_each_form_of_windows(data: bytes, tmp_path: Path):
    assert nodes_in(folder(tmp_path / "lab", {"quad.toml": data})) == {"safety": SAFETY}


def test_the_templates_nodes_need_no_quad_toml(tmp_path: Path):
    files = {"my_pressure.py": b"", "my_safety.py": b"", "notes.txt": b""}
    assert nodes_in(folder(tmp_path / "lab", files)) == {"safety": SAFETY, "pressure": PRESSURE}


def test_names_of_other_encodings_are_those_that_the_student_gave(tmp_path: Path):
    marked = zipped({"ü/my_safety.py": SOURCE})
    unmarked = marked.replace(b"\x00\x08", b"\x00\x00")
    dos = zipped({"??/my_safety.py": SOURCE}).replace(b"??/", "ü.".encode("cp437") + b"/")
    for number, (data, name) in enumerate([(marked, "ü"), (unmarked, "ü"), (dos, "ü.")]):
        copy = copied(written(tmp_path / f"{number}.zip", data), tmp_path / str(number))
        assert copy.name == name


def test_names_without_an_encoding_are_copied_as_different_ones(tmp_path: Path):
    names = [os.fsdecode(name) for name in (b"\xe4", b"\xf6")]
    own = folder(tmp_path / names[0], LAB | dict.fromkeys(names, b"x"))
    (own / "link").symlink_to(names[1])
    copy = copied(own, tmp_path / "own")
    assert {path.name for path in copy.iterdir()} == {*LAB, "link", "\\udce4", "\\udcf6"}
    assert (copy / "link").read_bytes() == b"x"
    inside = copied(written(tmp_path / "a.tar", tarred(below(names[0]))), tmp_path / "two")
    assert inside.name == encodable(names[0]) != encodable(names[1])


def test_only_the_members_of_an_export_are_copied(tmp_path: Path):
    data = zipped({"anna_1_2_my_safety.py": SOURCE, "bob_3_4_my_safety.py": b"", "../x": b""})
    members = {"anna_1_2_my_safety.py": "my_safety.py"}
    copy = copied(written(tmp_path / "a.zip", data), tmp_path / "own", members)
    assert [path.read_bytes() for path in copy.iterdir()] == [SOURCE]


BIG = {"big": bytes(20_000)}
MANY = {f"n{number}": b"" for number in range(20)}
BOMB = tarred({"my_safety.py": bytes(1 << 19)}, "w:gz")
XZ = lzma.compress(tarred())
BLOCK = XZ[12:16] + b"\x24" + XZ[17:20]
LARGE = XZ[:12] + BLOCK + struct.pack("<I", zlib.crc32(BLOCK)) + XZ[24:]
"""Archive of which the header of a block asks for a dictionary of 1 GB."""
LOCKED = replaced(zipped(), b"\x14\x00\x00\x00\x08\x00", b"\x14\x00\x01\x00\x08\x00")
"""Zip file whose headers have the mark of a password."""
REFUSED: dict[str, tuple[str, bytes, str]] = {
    "nothing": ("a.zip", b"", "it is empty"),
    "text": ("a.zip", b"no zip", "neither a folder, a zip or tar file, nor a .py file"),
    "bad CRC": ("a.zip", replaced(zipped(method=0), b"safe')", b"cafe')"), "damaged: Bad CRC-32 for file 'my_safety.py'"),
    "truncated zip": ("a.zip", zipped()[:-40], "damaged: "),
    "broken directory": ("a.zip", replaced(zipped(), b"PK\x01\x02", b"PK\x01\x03"), "damaged: Bad magic number"),
    "large directory": ("a.zip", zipped()[:-10] + b"\xff\xff\xff\x7f" + zipped()[-6:], "damaged: "),
    "LZMA": ("a.zip", zipped(method=zipfile.ZIP_LZMA), "it is compressed by LZMA"),
    "bzip2": ("a.zip", zipped(method=zipfile.ZIP_BZIP2), "it is compressed by bzip2"),
    "Deflate64": ("a.zip", replaced(zipped(), b"\x08\x00\x00\x00\x21\x00", b"\x09\x00\x00\x00\x21\x00"), "Deflate64"),
    "password": ("a.zip", LOCKED, "it is locked by a password"),
    "absolute name": ("a.zip", zipped(LAB | {"/etc/x": b""}), "/etc/x is outside its folder"),
    "drive": ("a.zip", zipped(LAB | {"C:\\x": b""}), "C:/x is outside its folder"),
    "share": ("a.zip", zipped(LAB | {"\\\\host\\x": b""}), "/host/x is outside its folder"),
    "dots": ("a.zip", zipped(LAB | {"a/../../x": b""}), "a/../../x is outside its folder"),
    "dots of Windows": ("a.tar", tarred(LAB | {"..\\x": b""}), "../x is outside its folder"),
    "link in a zip that leads out": ("a.zip", zipped_link("x", "../../etc"), "x is a link that leads out of it"),
    "link in a tar that leads out": ("a.tar", tarred(others=[special(tarfile.SYMTYPE, "x", "/etc")]), "x is a link"),
    "links that lead out together": ("a.tar", tarred(others=[special(tarfile.SYMTYPE, "a", "."), special(tarfile.SYMTYPE, "b", "a/..")]), "b is a link"),
    "file through a link": ("a.tar", tarred(others=[special(tarfile.SYMTYPE, "a", "/tmp"), special(tarfile.REGTYPE, "a/x")]), "both a file and a folder"),
    "hard link": ("a.tar", tarred(others=[special(tarfile.LNKTYPE, "x", "my_safety.py")]), "x is a hard link"),
    "device": ("a.tar", tarred(others=[special(tarfile.CHRTYPE, "x")]), "x is a device"),
    "pipe": ("a.tar", tarred(others=[special(tarfile.FIFOTYPE, "x")]), "x is a pipe"),
    "pipe in a zip": ("a.zip", zipped_link("x", "", 0o010000), "x is a pipe"),
    "zip bomb": ("a.zip", zipped(LAB | BIG), "more than 12 files or 0 MB are handed in"),
    "zip bomb that lies": ("a.zip", replaced(zipped(LAB | BIG), (20_000).to_bytes(4, "little"), (20).to_bytes(4, "little")), "damaged: Bad CRC"),
    "zip bomb of files": ("a.zip", zipped(LAB | MANY), "more than 12 files"),
    "zip bomb of folders": ("a.zip", zipped(LAB | {"/".join("a" * 20): b""}), "more than 12 files"),
    "tar bomb": ("a.tgz", BOMB, "more than 12 files or 0 MB are handed in"),
    "tar bomb in parts": ("a.zip", zipped({"b.zip": zipped({"x": bytes(6000), "c.tar": tarred({"y": bytes(6000)})})}), "more than 12"),
    "case": ("a.zip", zipped(LAB | {"My_safety.py": b""}), "my_safety.py and My_safety.py differ in case only"),
    "case of folders": ("a.zip", zipped(LAB | {"a/x": b"", "A/y": b""}), "a and A differ in case only"),
    "accents": ("a.zip", zipped(LAB | {"\u00fc": b"", "u\u0308": b""}), "differ in case only"),
    "twice": ("a.tar", tarred(others=[special(tarfile.REGTYPE, "quad.toml")]), "quad.toml is there twice"),
    "file and folder": ("a.zip", zipped(LAB | {"x/y": b"", "x": b""}), "x is both a file and a folder"),
    "long part": ("a.zip", zipped(LAB | {"x" * 300: b""}), "is too long a name"),
    "long name": ("a.zip", zipped(LAB | {"xy/" * 400 + "z": b""}), "is too long a name"),
    "line in a name": ("a.zip", zipped(LAB | {"../a\nb": b""}), "../a\\nb is outside its folder"),
    "nothing inside": ("a.zip", zipped({}), "it is empty"),
    "only junk": ("a.zip", zipped(JUNK), "it is empty"),
    "no lab": ("a.zip", zipped({"a.py": b""}), "it has neither quad.toml nor my_safety.py or my_pressure.py"),
    "one file of another name": ("anna.py", b"x", "it has neither quad.toml nor"),
    "two labs": ("a.zip", zipped(below("v1") | below("v2")), "it has 2 labs: v1, v2"),
    "two archives": ("a.zip", zipped({"v1.zip": b"x", "v2.zip": b"x"}), "it has 2 archives: v1.zip, v2.zip"),
    "four zips in one another": ("a.zip", zipped({"b.zip": zipped({"c.zip": zipped({"d.zip": zipped()})})}), "an archive in an archive in an archive"),
    "quad.toml a folder": ("a.zip", zipped({"quad.toml/x": b"", "my_safety.py": b""}), "quad.toml is a folder"),
    "truncated tar": ("a.tar", tarred()[:1100], "damaged: "),
    "tar without an end": ("a.tar", tarred()[:2560], "damaged: "),
    "broken header": ("a.tar", flipped(tarred(), 1024), "damaged: bad checksum"),
    "truncated tar.gz": ("a.tgz", tarred(mode="w:gz")[:-20], "damaged: "),
    "flipped tar.gz": ("a.tgz", flipped(tarred(mode="w:gz"), 60), "damaged: "),
    "truncated tar.xz": ("a.tar.xz", tarred(mode="w:xz")[:-20], "damaged: "),
    "checksum of a tar.gz": ("a.tgz", flipped(tarred(mode="w:gz"), -6 + len(tarred(mode="w:gz"))), "damaged: CRC check failed"),
    "large header": ("a.tgz", gzip.compress(header(b"x", 20_000)), "damaged: a header is too large"),
    "headers of headers": ("a.tgz", gzip.compress(header(b"x", 2) * 5000), "damaged: maximum recursion depth"),
    "tar of too much junk": ("a.tgz", tarred({"flight.mcap": bytes(2 << 20)}, "w:gz"), "it takes more than 1 MB"),
    "too many entries": ("a.zip", zipped({f"env/{n}": b"" for n in range(101)}), "it has more than 100 entries"),
    "directory too large": ("a.zip", zipped({f"env/{n:0200}": b"" for n in range(90)}), "damaged: its directory is too large"),
    "large dictionary": ("a.tar.xz", LARGE, "damaged: Memory"),
    "gz without a tar": ("a.gz", gzip.compress(b"x" * 2000), "damaged: "),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_is_refused_by_one_line_with_the_cause_and_what_to_do(name: str, tmp_path: Path):
    file, data, cause = REFUSED[name]
    with pytest.raises(Invalid) as refused:
        copied(written(tmp_path / file, data), tmp_path / "own")
    assert cause in refused.value.message
    assert refused.value.hint
    assert "\n" not in refused.value.message


def pipe(path: Path) -> None:
    os.mkfifo(path)


def plug(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as opened:
        opened.bind(str(path))


SPECIAL: dict[str, tuple[Callable[[Path], Any], str]] = {
    "pipe": (pipe, "x is a pipe"),
    "socket": (plug, "x is a socket"),
    "link that leads out": (lambda path: path.symlink_to("../.."), "x is a link that leads out of it"),
    "absolute link": (lambda path: path.symlink_to("/etc/passwd"), "x is a link that leads out of it"),
    "link to a neighbour": (lambda path: path.symlink_to("../anna2"), "x is a link that leads out of it"),
    "case": (lambda path: path.with_name("My_safety.py").touch(), "differ in case only"),
    "many": (lambda path: folder(path, MANY), "more than 12 files"),
    "big": (lambda path: folder(path, BIG), "more than 12 files"),
    "quad.toml a folder": (lambda path: (path / "quad.toml").mkdir(parents=True), "x/quad.toml is a folder"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPECIAL)
def test_a_folder_is_refused(name: str, tmp_path: Path):
    make, cause = SPECIAL[name]
    make(folder(tmp_path / "anna") / "x")
    with pytest.raises(Invalid, match=cause):
        copied(tmp_path / "anna", tmp_path / "own")


def test_an_empty_folder_and_what_is_no_file_are_refused(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    for path, cause in ((folder(tmp_path / "anna", {}), "empty"), (tmp_path / "pipe", "neither")):
        with pytest.raises(Invalid, match=cause):
            copied(path, tmp_path / f"own of {path.name}")


def test_what_cannot_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Root may read all, so the system's answer is a stand-in."""
    own = folder(tmp_path / "anna", LAB | {"lib/x": b""})
    real: dict[str, Any] = {"listdir": os.listdir, "open": os.open}

    def denying(call: str, name: str) -> Callable[..., Any]:
        def denied(path: Any, *words: Any) -> Any:
            if Path(path).name == name:
                raise PermissionError(errno.EACCES, "Permission denied", str(path))
            return real[call](path, *words)

        return denied

    for call, name, cause in (
        ("listdir", "lib", "lib is a folder that cannot be read: Permission denied"),
        ("open", "my_safety.py", "it cannot be copied: my_safety.py: Permission denied"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(os, call, denying(call, name))
            with pytest.raises(Invalid) as refused:
                copied(own, tmp_path / f"own of {name}")
        assert refused.value.message == cause


@pytest.mark.parametrize("becomes", ["nothing", "a pipe", "a link"])
def test_a_folder_that_changes_while_it_is_copied_is_refused(
    becomes: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    own = folder(tmp_path / "anna")
    last = own / "quad.toml"
    real = archives._open

    def changing(path: Path) -> Any:
        last.unlink(missing_ok=True)
        if becomes == "a pipe":
            os.mkfifo(last)
        elif becomes == "a link":
            last.symlink_to("/etc/passwd")
        return real(path)

    monkeypatch.setattr(archives, "_open", changing)
    with pytest.raises(Invalid, match=r"changed while it was copied|Too many levels"):
        copied(own, tmp_path / "own")


@pytest.mark.parametrize("form", ["zip", "tar", "tgz", "tar.xz"])
def test_no_damage_is_more_than_a_refusal(form: str, tmp_path: Path):
    """A damaged hand-in is refused, or copied whole if the damage is in what no reader looks at."""
    modes = {"tar": "w", "tgz": "w:gz", "tar.xz": "w:xz"}
    whole, chosen = zipped() if form == "zip" else tarred(mode=modes[form]), random.Random(form)
    hints = []
    for number in range(100):
        at = chosen.randrange(min(len(whole), 3500))
        data = whole[:at] if number % 5 == 0 else flipped(whole, at, number % 8)
        try:
            copied(written(tmp_path / f"a.{form}", data), tmp_path / str(number))
        except Invalid as problem:
            hints.append(problem.hint)
    assert len(hints) > 20
    assert all(hints)
