"""A realm's name and folder."""

import os
import resource
import stat
from pathlib import Path
from typing import Any

import pytest

from quadctl.services.runtime.errors import QuadctlError, UsageError
from quadctl.services.runtime.realm import Realm, default_name, write_atomically


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Point XDG_RUNTIME_DIR at a test folder, and allow longer socket paths."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("quadctl.services.runtime.realm._LONGEST_SOCKET_PATH", 1000)
    return tmp_path


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize("name", ["default", "a", "lab-1", "A.b_c", "0", "x" * 40, "demo-4711"])
def test_a_valid_name_is_accepted(root: Path, name: str):
    assert Realm(name).folder == root / "quadctl" / name


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../x", "a/b", "-x", ".x", "_x", "a b", "a\n", "\n", "ä", "x" * 41, "a\0", "*"],
)
def test_an_invalid_name_is_rejected(root: Path, name: str):
    with pytest.raises(UsageError, match="is not a valid name for a realm") as caught:
        Realm(name)
    assert caught.value.exit_code == 2
    assert "letters" in caught.value.hint


def test_the_files_of_a_realm_are_in_its_folder(root: Path):
    realm = Realm("lab")
    assert realm.socket == root / "quadctl" / "lab" / "hub.sock"
    assert {path.parent for path in (realm.address, realm.record, realm.lock)} == {realm.folder}
    assert not realm.folder.exists()


def test_the_folder_is_private_to_its_owner(root: Path, monkeypatch: pytest.MonkeyPatch):
    old = os.umask(0)
    try:
        realm = Realm("lab")
        realm.create()
    finally:
        os.umask(old)
    assert mode(realm.folder) == mode(realm.folder.parent) == 0o700


def test_the_mode_of_an_existing_folder_is_tightened(root: Path):
    realm = Realm("lab")
    realm.folder.mkdir(parents=True)
    realm.folder.chmod(0o777)
    realm.create()
    assert mode(realm.folder) == 0o700


def test_a_folder_of_another_user_is_refused(root: Path, monkeypatch: pytest.MonkeyPatch):
    realm = Realm("lab")
    realm.create()
    monkeypatch.setattr(os, "getuid", lambda: realm.folder.stat().st_uid + 1)
    for use in (realm.create, lambda: Realm("lab")):
        with pytest.raises(UsageError, match="quadctl belongs to another user") as caught:
            use()
        assert "XDG_RUNTIME_DIR" in caught.value.hint


def test_a_link_in_place_of_a_folder_is_not_followed(root: Path):
    precious = root / "precious" / "lab" / "thesis.txt"
    precious.parent.mkdir(parents=True)
    precious.write_text("years of work")
    realm = Realm("lab")
    (root / "quadctl").symlink_to(precious.parents[1])
    for use in (realm.create, lambda: Realm("lab")):
        with pytest.raises(UsageError, match="quadctl is a link"):
            use()
    assert precious.read_text() == "years of work"


def test_links_inside_the_folder_are_removed_and_not_followed(root: Path):
    precious = root / "thesis.txt"
    precious.write_text("years of work")
    realm = Realm("lab")
    realm.create()
    realm.logs.symlink_to(root)
    realm.clear()
    assert list(realm.folder.iterdir()) == []
    assert precious.read_text() == "years of work"


@pytest.mark.parametrize("unset", [None, ""])
def test_without_xdg_the_realm_is_in_the_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unset: str | None
):
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    if unset is not None:
        monkeypatch.setenv("XDG_RUNTIME_DIR", unset)
    monkeypatch.setenv("TMPDIR", "/somewhere")
    assert Realm("lab").folder == Path(f"/somewhere/quadctl-{os.getuid()}/lab")
    monkeypatch.delenv("TMPDIR")
    assert Realm("lab").folder == Path(f"/tmp/quadctl-{os.getuid()}/lab")


def test_a_path_too_long_for_a_socket_is_refused_at_once(monkeypatch: pytest.MonkeyPatch):
    # 100 bytes with the 21 of "/quadctl/lab/hub.sock".
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/" + "x" * 78)
    assert len(os.fsencode(Realm("lab").socket)) == 100
    with pytest.raises(UsageError, match="too long for a Unix socket") as caught:
        Realm("labs")
    assert "--realm" in caught.value.hint
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/" + "ä" * 40)
    with pytest.raises(UsageError, match="too long"):
        Realm("lab")


@pytest.mark.parametrize(("value", "name"), [(None, "default"), ("", "default"), ("x", "x")])
def test_the_default_realm_comes_from_the_environment(
    monkeypatch: pytest.MonkeyPatch, value: str | None, name: str
):
    monkeypatch.delenv("QUADCTL_REALM", raising=False)
    if value is not None:
        monkeypatch.setenv("QUADCTL_REALM", value)
    assert default_name() == name


@pytest.mark.parametrize("variable", ["XDG_RUNTIME_DIR", "TMPDIR"])
def test_a_relative_folder_is_refused(monkeypatch: pytest.MonkeyPatch, variable: str):
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv(variable, "run")
    with pytest.raises(UsageError, match=f"{variable} is run, a relative path") as caught:
        Realm("lab")
    assert str(Path("run").absolute()) in caught.value.hint


def test_a_folder_that_cannot_be_created_is_an_error_with_the_reason(root: Path):
    (root / "quadctl").touch()
    with pytest.raises(QuadctlError, match="quadctl cannot be created: ") as caught:
        Realm("lab").create()
    assert "XDG_RUNTIME_DIR" in caught.value.hint


def test_clear_keeps_the_lock_and_the_socket(root: Path):
    realm = Realm("lab")
    realm.create()
    for path in (realm.lock, realm.socket, realm.record, realm.address, realm.folder / ".x.1"):
        path.write_text("x")
    for folder in (realm.params, realm.logs, realm.restart_requests):
        folder.mkdir()
        (folder / "old").write_text("x")
    realm.clear()
    assert set(realm.folder.iterdir()) == {realm.lock, realm.socket}


def test_a_failed_write_keeps_the_old_file(tmp_path: Path):
    path = tmp_path / "run.json"
    path.write_bytes(b"old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            write_atomically(path, b"new")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_remove_leaves_nothing(root: Path):
    realm = Realm("lab")
    realm.create()
    for path in (realm.lock, realm.record, realm.address):
        path.write_text("x")
    realm.logs.mkdir()
    (realm.logs / "hub.log").write_text("x")
    realm.remove()
    assert not realm.folder.exists()


def test_a_request_that_arrives_during_the_removal_is_removed(
    root: Path, monkeypatch: pytest.MonkeyPatch
):
    realm = Realm("lab")
    realm.create()
    realm.restart_requests.mkdir()
    removes = os.rmdir

    def late(*place: Any, **more: Any) -> None:
        patched.undo()
        (realm.restart_requests / "hub").touch()
        removes(*place, **more)

    with monkeypatch.context() as patched:
        patched.setattr(os, "rmdir", late)
        realm.remove()
    assert not realm.folder.exists()


def test_a_file_is_replaced_atomically(tmp_path: Path):
    path = tmp_path / "run.json"
    path.write_bytes(b"old")
    with path.open("rb") as reader:
        write_atomically(path, b"new")
        assert reader.read() == b"old"
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows has no such modes")
def test_a_folder_that_cannot_be_entered_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def closed(path: str) -> None:
        raise PermissionError(13, "Permission denied", path)

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(os, "lstat", closed)
    with pytest.raises(UsageError, match="quadctl is closed to this user") as caught:
        Realm("lab")
    assert caught.value.hint == "set XDG_RUNTIME_DIR to a folder of your own"
