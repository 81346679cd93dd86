"""New files: written completely or not at all."""

import resource
from pathlib import Path

import pytest

from quadctl.services.runtime.errors import Invalid
from quadctl.services.runtime.files import write_new


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
