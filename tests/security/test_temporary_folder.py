"""Links and folders of other users, made in the temporary folder before the first run."""

import os
from pathlib import Path

import pytest

from tests.support.lab import Lab

COMMANDS = ("up -d", "status", "state", "goto 1 0 1", "down", "node logs", "param get safety")


@pytest.fixture
def temporary(lab: Lab) -> Path:
    """Return the folder that the lab's runs would use in TMPDIR."""
    lab.environment |= {"TMPDIR": str(lab.folder), "XDG_RUNTIME_DIR": ""}
    return lab.folder / f"quadctl-{os.getuid()}"


def test_a_link_to_the_users_own_files_is_refused(lab: Lab, temporary: Path):
    precious = lab.folder / "precious" / lab.realm / "thesis.txt"
    precious.parent.mkdir(parents=True)
    precious.write_text("years of work")
    temporary.symlink_to(precious.parents[1])
    for line, done in lab.each(COMMANDS).items():
        assert (done.code, f"{temporary} is a link" in done.err) == (2, True), (line, done)
    assert precious.read_text() == "years of work"
    assert list(precious.parent.iterdir()) == [precious]


@pytest.mark.needs("users")
def test_a_folder_of_another_user_is_refused(lab: Lab, temporary: Path):
    temporary.mkdir(mode=0o777)
    os.chown(temporary, 65534, 65534)
    for line, done in lab.each(COMMANDS).items():
        assert (done.code, f"{temporary} belongs to another user" in done.err) == (2, True), line
    assert "belongs to another user" in lab.quadctl("doctor").out
    assert list(temporary.iterdir()) == []
