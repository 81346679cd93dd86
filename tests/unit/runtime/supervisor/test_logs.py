"""Log of a run: every line with its process's name, on stdout and in a file."""

import errno
import io
import os
import re
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from quadctl.services.runtime.supervisor import logs as log_module
from quadctl.services.runtime.supervisor.logs import DiskFault, LogFile, Logs, Printer


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(log_module, "LARGEST", 100)
    return 100


@contextmanager
def full_disk() -> Iterator[None]:
    """Prevent the files of this process from growing, as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_only_one_full_file_is_kept(tmp_path: Path, small: int):
    file = LogFile(tmp_path / "yes.log")
    for number in range(1000):
        file.write(f"line {number}")
        sizes = [path.stat().st_size for path in tmp_path.iterdir()]
        assert max(sizes) <= small
        assert len(sizes) <= 2
    file.close()
    both = [(tmp_path / name).read_text() for name in ("yes.log.1", "yes.log")]
    lines = "".join(both).splitlines()
    assert lines == [f"line {n}" for n in range(1000 - len(lines), 1000)]
    assert len(lines) > 10


def test_the_size_limit_is_a_few_megabytes():
    assert 1e6 < log_module.LARGEST < 1e7


def test_a_line_is_written_completely_or_not_at_all(tmp_path: Path):
    file = LogFile(tmp_path / "x.log")
    file.write("first")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
    try:
        with pytest.raises(OSError, match="No space left"):
            file.write("half of it")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    file.write("second")
    file.close()
    assert (tmp_path / "x.log").read_text() == "first\nsecond\n"


def test_control_characters_of_a_process_are_shown_escaped():
    out = io.StringIO()
    Printer(out.write, colour=False)("mine", "\x1b[2J a\u202eb", 0.0)
    assert out.getvalue().endswith("| \\x1b[2J a\\u202eb\n")


def test_a_full_disk_is_reported_once_and_lines_are_still_shown(tmp_path: Path):
    shown: list[tuple[str, str]] = []
    logs = Logs(tmp_path / "logs", lambda name, line, at: shown.append((name, line)))
    logs.show("hub", "before")
    with full_disk():
        for number in range(3):
            logs.show("hub", f"lost {number}")
            logs.look(1e12)
    assert [line for name, line in shown if name == "hub"] == [
        "before",
        "lost 0",
        "lost 1",
        "lost 2",
    ]
    (fault,) = [line for name, line in shown if name == "up"]
    assert str(tmp_path) in fault
    assert os.strerror(errno.EFBIG) in fault
    assert logs.last("hub").endswith("lost 2")
    logs.look(2e12)
    logs.show("hub", "after")
    logs.close()
    over = f"{tmp_path} can be written again; 3 lines were lost"
    assert [line for name, line in shown if name == "up"][1:] == [over]
    assert (tmp_path / "logs" / "up.log").read_text() == f"{over}\n"
    assert (tmp_path / "logs" / "hub.log").read_text() == "before\nafter\n"
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


def test_a_disk_fault_is_probed_only_now_and_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    probed: list[Path] = []
    monkeypatch.setattr(log_module, "probe", probed.append)
    broken = DiskFault(tmp_path, lambda line: None)
    assert broken.probe(1.0) == ""
    assert broken.try_write(lambda: None)
    (tmp_path / "file").touch()
    assert not broken.try_write((tmp_path / "file" / "in it").touch)
    assert broken.probe(0.0) == ""
    assert probed == []
    assert "can be written again; 0 lines" in broken.probe(1e12)
    assert probed == [tmp_path]


def test_a_removed_folder_is_no_disk_fault(tmp_path: Path):
    reported: list[str] = []
    assert not DiskFault(tmp_path, reported.append).write((tmp_path / "no" / "folder").touch)
    assert reported == []


LINE = r"\d\d:\d\d:\d\d\.\d\d\d "


Make = Callable[..., Logs]


@pytest.fixture
def made(tmp_path: Path) -> Iterator[Make]:
    """Yield a function that creates logs, and close them: a run keeps its files open."""
    every: list[Logs] = []

    def make(out: io.StringIO, *, colour: bool = False) -> Logs:
        every.append(Logs(tmp_path / "logs", Printer(out.write, colour=colour)))
        return every[-1]

    yield make
    for logs in every:
        logs.close()


def test_a_line_has_time_and_name_and_no_colour_when_piped(made: Make):
    out = io.StringIO()
    logs = made(out)
    logs.show("hub", "up")
    logs.show("dynamics", "boot 1")
    first, second = out.getvalue().splitlines()
    assert re.fullmatch(LINE + r"hub      \| up", first)
    assert re.fullmatch(LINE + r"dynamics \| boot 1", second)


def test_each_process_has_its_colour_on_a_terminal(made: Make):
    out = io.StringIO()
    logs = made(out, colour=True)
    for name in ("hub", "safety", "hub"):
        logs.show(name, "said")
    colours = re.findall(r"\x1b\[(\d\d)m", out.getvalue())
    assert colours[0] == colours[2]
    assert colours[0] != colours[1]
    assert all(line.endswith("\x1b[0m said") for line in out.getvalue().splitlines())


def test_colours_repeat_with_many_processes(made: Make):
    out = io.StringIO()
    logs = made(out, colour=True)
    for number in range(20):
        logs.show(f"node{number}", "said")
    assert len(out.getvalue().splitlines()) == 20


def test_the_file_gets_the_bare_line_at_once_and_is_appended(made: Make, tmp_path: Path):
    folder = tmp_path / "logs"
    logs = made(io.StringIO())
    logs.show("safety", "Param: cage x - [-5.0, 5.0]")
    assert (folder / "safety.log").read_text() == "Param: cage x - [-5.0, 5.0]\n"
    logs.show("safety", "größer")
    made(io.StringIO()).show("safety", "again")
    text = (folder / "safety.log").read_text(encoding="utf-8")
    assert text.splitlines()[1:] == ["größer", "again"]


@pytest.mark.parametrize(("count", "first"), [(3, 0), (20, 0), (25, 5)])
def test_the_last_twenty_lines_are_kept(made: Make, count: int, first: int):
    logs = made(io.StringIO())
    for number in range(count):
        logs.show("hub", f"line {number}")
    assert logs.last("hub").splitlines() == [f"  line {n}" for n in range(first, count)]
    assert logs.last("nobody") == ""


def test_a_line_has_the_time_of_its_arrival(made: Make):
    out = io.StringIO()
    made(out).show("hub", "up", 1e9 + 0.25)
    assert out.getvalue()[5:12] == ":40.250"
