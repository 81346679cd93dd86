"""Facts of a process from /proc, here a made-up one."""

import os
from pathlib import Path

import pytest

from quadctl.services.runtime import procfs
from quadctl.services.runtime.procfs import (
    ProcessStats,
    WaitMeter,
    has_ended,
    is_frozen,
    parent_of,
    pss_of,
    stats_of,
)


@pytest.fixture
def proc(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "self").mkdir()
    monkeypatch.setattr(procfs, "_PROC", tmp_path)
    monkeypatch.setattr(os, "sysconf", {"SC_PAGE_SIZE": 4096, "SC_CLK_TCK": 100}.__getitem__)
    monkeypatch.setattr("time.clock_gettime", lambda clock: 60.0)
    return tmp_path


def write(proc: Path, state: str, **files: str) -> None:
    (proc / "7").mkdir(exist_ok=True)
    fields = ["3", *"0" * 9, "150", "50", *"0" * 6, "5000", "0"]
    files |= {"stat": f"7 (a (b) c) {state} {' '.join(fields)}\n"}
    for name, text in files.items():
        (proc / "7" / name).write_text(text)


def test_a_running_process_is_read(proc: Path):
    write(
        proc,
        "S",
        statm="9000 1000 5 1 0 1 0\n",
        smaps_rollup="5-7 ---p 0 00:00 0 [rollup]\nRss: 9 kB\nPss:   3 kB\nPss_Dirty: 1 kB\n",
    )
    assert stats_of(7) == ProcessStats(state="S", rss=4_096_000, cpu=2.0, uptime=10.0)
    assert (pss_of(7), parent_of(7), has_ended(7), is_frozen(7)) == (3072, 3, False, False)


def test_a_stopped_process_of_another_user_has_no_pss(proc: Path):
    write(proc, "T", statm="9000 1000 5 1 0 1 0\n")
    assert is_frozen(7)
    assert pss_of(7) is None


def test_a_zombie_has_ended(proc: Path):
    write(proc, "Z", statm="0 0 0 0 0 0 0\n", smaps_rollup="")
    assert (stats_of(7).state, stats_of(7).rss, pss_of(7)) == ("Z", None, None)
    assert has_ended(7)


def test_a_process_that_is_gone_has_ended(proc: Path):
    assert stats_of(8) == ProcessStats(state="")
    assert (pss_of(8), parent_of(8), has_ended(8), is_frozen(8)) == (None, None, True, False)


def test_without_proc_nothing_is_known(proc: Path):
    (proc / "self").rmdir()
    assert stats_of(8) == ProcessStats()
    assert (pss_of(8), parent_of(8), has_ended(8), is_frozen(8)) == (None, None, False, False)


def test_this_process_is_read(monkeypatch: pytest.MonkeyPatch):
    if not Path("/proc/self/stat").exists():
        pytest.skip("this system has no /proc")
    found = stats_of(os.getpid())
    assert found.state == "R"
    assert found.rss
    assert found.rss > 1e6
    assert found.cpu
    assert found.uptime
    assert found.uptime > 0
    assert parent_of(os.getpid()) == os.getppid()


def test_the_longest_wait_of_a_process_and_its_descendants_counts(proc: Path):
    def waited(pid: int, seconds: float, children: str = "") -> None:
        (proc / str(pid) / "task" / str(pid)).mkdir(parents=True, exist_ok=True)
        (proc / str(pid) / "schedstat").write_text(f"900 {round(seconds * 1e9)} 3\n")
        (proc / str(pid) / "task" / str(pid) / "children").write_text(children)

    meter = WaitMeter()
    assert meter.read(7) == 0, "no such process"
    waited(7, 1.0)
    assert meter.read(7) == 1.0
    waited(7, 1.5, "8 9 ")
    waited(8, 0.25)
    waited(9, 2.0)
    assert meter.read(7) == 2.0
    waited(9, 2.125)
    assert meter.read(7) == 0.125
    (proc / "8" / "schedstat").unlink()
    assert meter.read(7) == 0, "one has ended"
