"""File lock: one holder, reported to others, released by its death."""

import fcntl
import os
import resource
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from quadctl.services.runtime.errors import AlreadyServed
from quadctl.services.runtime.filelock import FileLock

HOLDER = """
import sys
from pathlib import Path
from quadctl.services.runtime.filelock import FileLock
with FileLock(Path(sys.argv[1]), "the realm lab"):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "up.lock"


@pytest.fixture
def holder(path: Path) -> Iterator["subprocess.Popen[str]"]:
    """Yield another process that holds the lock."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_holder_is_refused_with_the_pid_of_the_first(
    path: Path, holder: "subprocess.Popen[str]"
):
    with pytest.raises(AlreadyServed) as caught:
        FileLock(path, "the realm lab", "try another").acquire()
    assert caught.value.message == f"the realm lab is already held by process {holder.pid}"
    assert caught.value.hint == "try another"
    assert caught.value.exit_code == 7
    assert FileLock(path, "").held()


def test_kill_9_of_the_holder_releases_the_lock(path: Path, holder: "subprocess.Popen[str]"):
    holder.kill()
    holder.wait()
    assert not FileLock(path, "").held()
    with FileLock(path, "the realm lab"):
        assert path.read_text() == str(os.getpid())


def test_a_normal_exit_of_the_holder_releases_the_lock(path: Path, holder: "subprocess.Popen[str]"):
    holder.communicate()
    FileLock(path, "the realm lab").acquire().release()


def test_the_lock_is_held_within_the_block_and_free_after_it(path: Path):
    lock, other = FileLock(path, "it"), FileLock(path, "it")
    with lock:
        assert other.held()
        with pytest.raises(AlreadyServed, match=f"process {os.getpid()}"):
            other.acquire()
    assert not other.held()
    lock.release()
    assert path.stat().st_mode & 0o777 == 0o600


def test_processes_that_check_the_lock_do_not_count_as_its_holder(path: Path):
    path.touch()
    with path.open("rb") as checker:
        fcntl.flock(checker, fcntl.LOCK_SH | fcntl.LOCK_NB)
        assert not FileLock(path, "it").held()


def test_acquire_waits_for_processes_that_check_the_lock(path: Path):
    path.touch()
    with path.open("rb") as checker:
        fcntl.flock(checker, fcntl.LOCK_SH | fcntl.LOCK_NB)
        timer = threading.Timer(0.2, checker.close)
        timer.start()
        with FileLock(path, "it") as lock:
            assert lock.held()
        timer.join()


def test_the_lock_is_valid_until_its_file_is_removed(path: Path):
    with FileLock(path, "it") as lock:
        assert lock.is_held_by_us()
        path.unlink()
        assert not lock.is_held_by_us()
        path.touch()
        assert not lock.is_held_by_us()
    assert not lock.is_held_by_us()


def test_a_full_disk_does_not_prevent_locking(path: Path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
    try:
        with FileLock(path, "it") as lock:
            assert lock.is_held_by_us()
            with pytest.raises(AlreadyServed, match="process unknown"):
                FileLock(path, "it").acquire()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_shorter_pid_overwrites_a_longer_one_completely(path: Path):
    path.write_text("4711471147114711")
    with FileLock(path, "it"):
        assert path.read_text() == str(os.getpid())


def test_a_holder_that_has_not_written_its_pid_is_unknown(path: Path):
    with FileLock(path, "it"):
        path.write_text("")
        with pytest.raises(AlreadyServed, match="held by process unknown"):
            FileLock(path, "it").acquire()


@pytest.mark.thorough
def test_a_removed_file_is_not_the_lock(path: Path, monkeypatch: pytest.MonkeyPatch):
    """A holder that ends may remove the file after we open it and before we lock it."""
    opened = os.open

    def open_then_lose(*args: object) -> int:
        fd = opened(*args)  # type: ignore[arg-type]
        path.unlink()
        return fd

    monkeypatch.setattr(os, "open", open_then_lose)
    with pytest.raises(AlreadyServed):
        FileLock(path, "it").acquire()
