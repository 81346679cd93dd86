"""Files written completely or not at all."""

import os
import resource
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.files import read_text, write_new, write_whole
from quadctl.services.runtime.realm import write_atomically
from quadctl.services.runtime.security import authority
from tests.support.running import eventually


def test_an_existing_file_is_not_overwritten(tmp_path: Path):
    file = tmp_path / "new.toml"
    write_new(file, "a = 1\n")
    with pytest.raises(Invalid, match="already exists"):
        write_new(file, "a = 2\n")
    assert file.read_text(encoding="utf-8") == "a = 1\n"


def test_a_full_disk_leaves_no_partial_file(tmp_path: Path):
    file, before = tmp_path / "new.toml", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(Invalid, match="cannot be written") as caught:
            write_new(file, "a = 1\n" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.hint == "make room on its disk"
    assert not file.exists()


def test_a_symbolic_link_and_the_file_mode_are_kept(tmp_path: Path):
    real, link = tmp_path / "real.toml", tmp_path / "quad.toml"
    real.write_bytes(b"old")
    real.chmod(0o640)
    link.symlink_to("real.toml")
    write_whole(link, b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"
    assert real.stat().st_mode & 0o777 == 0o640
    assert sorted(path.name for path in tmp_path.iterdir()) == ["quad.toml", "real.toml"]


def test_a_new_file_has_the_usual_mode(tmp_path: Path):
    write_whole(tmp_path / "new.toml", b"text")
    (tmp_path / "any").write_bytes(b"")
    assert (tmp_path / "new.toml").stat().st_mode == (tmp_path / "any").stat().st_mode


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    file = tmp_path / "quad.toml"
    file.write_bytes(b"old")

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(Invalid, match="No space left"):
        write_whole(file, b"new")
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("write", [write_whole, write_atomically, authority._write])
def test_ctrl_c_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[[Path, bytes], None]
):
    file = tmp_path / "quad.toml"
    file.write_bytes(b"old")

    def interrupted(_self: Path, _target: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(file, b"new")
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


def test_an_unwritable_path_is_an_error(tmp_path: Path):
    for place in (tmp_path, tmp_path / "nowhere" / "quad.toml"):
        with pytest.raises(Invalid, match="cannot be written"):
            write_whole(place, b"new")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.timeout(20)
def test_a_pipe_without_a_writer_is_refused_and_one_with_a_writer_is_read(tmp_path: Path):
    pipe = tmp_path / "quad.toml"
    os.mkfifo(pipe)
    with pytest.raises(Invalid, match="is a pipe to which nothing writes"):
        read_text(pipe, "name a file")
    writer = threading.Thread(target=pipe.write_text, args=("text",))
    writer.start()

    def content() -> str:
        with suppress(Invalid):  # the writer is not there yet
            return read_text(pipe, "name a file").text
        return ""

    assert eventually(content) == "text"
    writer.join()
