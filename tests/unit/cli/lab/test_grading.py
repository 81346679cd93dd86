"""Grades of a class of which some hand-ins cannot be graded."""

import csv
import io
import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from quadctl.cli.lab import formats, grading
from quadctl.cli.lab.handin import HandIn
from quadctl.cli.lab.judge import RowResult
from quadctl.cli.lab.machine import Limits, Machine
from quadctl.cli.lab.rubric import Rubric
from tests.support.archives import LAB, folder

ROW = {"name": "flies", "expect": "arrives", "rows": [{"at": 4.0, "do": "goto", "x": 1.0, "y": 1.0, "z": 1.0}]}  # fmt: skip


def grades(*paths: Path, **more: Any) -> list[formats.Grade]:
    callbacks: dict[str, Any] = {"on_done": lambda _grade: None} | more
    return grading.grade(
        [HandIn(path.name, path) for path in paths], {"row": [ROW]}, Limits(), jobs=2,
        machine=Machine(), **callbacks,
    )  # fmt: skip


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every hand-in fly well, but for one with which the grader itself fails."""

    def fly(
        job: grading.GradingJob, made: Rubric, _judges: object, on_row: Callable[[RowResult], None]
    ) -> list[RowResult]:
        if (Path(job.folder) / "worse.txt").exists():
            raise ZeroDivisionError("float\ndivision")
        if job.evidence:
            (Path(job.evidence) / "safety.log").write_text("flying", "utf-8")
        results = [
            RowResult(row.name, row.number, True, 1.0, 1.0, "arrived", True) for row in made.rows
        ]
        for result in results:
            on_row(result)
        return results

    monkeypatch.setattr(grading, "_flown", fly)


@pytest.mark.usefixtures("flown")
def test_an_error_of_ours_costs_that_hand_in_only(tmp_path: Path):
    good, bad, last = (folder(tmp_path / name) for name in ("good", "bad", "last"))
    (bad / "worse.txt").touch()
    first, second, third = grades(good, bad, last)
    assert (first.score, second.score, third.score) == (1, 0, 1)
    why = "internal error: ZeroDivisionError: float division; try: grade it by itself"
    assert (first.problem, second.problem, third.problem) == ("", why, "")


@pytest.mark.usefixtures("flown")
def test_what_is_not_gradable_says_what_to_do_and_is_told_from_no_points(tmp_path: Path):
    no_node = folder(tmp_path / "bob", LAB | {"quad.toml": b""})
    found = grades(folder(tmp_path / "anna"), no_node)
    why = (
        'quad.toml names no node under [processes]; try: [processes] safety = "python my_safety.py"'
    )
    anna, bob = csv.DictReader(io.StringIO(formats.written("csv", found), newline=""))
    assert (anna["points"], anna["comment"]) == ("1", "")
    assert (bob["points"], bob["comment"]) == ("0", f"not gradable: {why}")
    problems = [each["problem"] for each in json.loads(formats.written("json", found))]
    assert problems == ["", why]


@pytest.mark.usefixtures("flown")
def test_rows_and_grades_are_told_in_the_callers_thread_and_evidence_before_it_goes(tmp_path: Path):
    told: list[tuple[str, bool]] = []
    logs: dict[str, str] = {}

    def tell(name: str) -> None:
        told.append((name, threading.current_thread() is threading.main_thread()))

    def keep(handin: HandIn, evidence: Path) -> None:
        logs[handin.name] = (evidence / "safety.log").read_text("utf-8")

    grades(
        *(folder(tmp_path / name) for name in ("a", "b")),
        on_done=lambda grade: tell(grade.submission),
        on_row=lambda result: tell(result.name),
        keep=keep,
    )
    assert sorted(told) == [("a", True), ("b", True), ("flies", True), ("flies", True)]
    assert logs == {"a": "flying", "b": "flying"}


@pytest.mark.usefixtures("flown")
def test_an_error_of_the_caller_ends_the_grading(tmp_path: Path):
    def fail(_grade: formats.Grade) -> None:
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        grades(folder(tmp_path / "a"), on_done=fail)


def test_csv_has_the_names_of_students_without_the_ends_of_archives():
    names = ["c/anna.tar.gz", "c/bob.TGZ", "c/cleo_12", "c/Dora E. Fox"]
    text = formats.written("csv", [formats.Grade(name, []) for name in names])
    rows = csv.DictReader(io.StringIO(text, newline=""))
    assert [row["student"] for row in rows] == ["anna", "bob", "cleo_12", "Dora E. Fox"]
