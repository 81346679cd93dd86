"""Folder of a class: what each student's has, safe names, and rows that are graded anew."""

import json
import sys
from pathlib import Path, PureWindowsPath

import msgspec
import pytest
from hypothesis import given, strategies as st

from quadctl.cli.lab import report
from quadctl.cli.lab.formats import Grade
from quadctl.cli.lab.handin import HandIn
from quadctl.cli.lab.judge import NOT_FLOWN, RowResult
from quadctl.cli.lab.report import ClassRecord, ClassReport, folder_name, merged, record_in
from quadctl.services.runtime.errors import Invalid

RUBRIC = {"row": [{"name": "flies", "expect": "arrives"}]}


def row(name: str, output: str, *, ok: bool = False) -> RowResult:
    return RowResult(name, name, ok, float(ok), 1.0, output, True, "" if ok else "look")


def of_class(folder: Path, *names: str, anew: bool = False) -> tuple[ClassReport, list[str]]:
    """Return the report of a class that these hand-ins have entered, and its notes to come."""
    notes: list[str] = []
    record = record_in(folder) or ClassRecord(19, RUBRIC)
    made = ClassReport(folder, record, notes.append)
    made.enter([HandIn(name, Path(name)) for name in names], anew=anew)
    return made, notes


def evidence(folder: Path, **files: str) -> Path:
    folder.mkdir()
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text, "utf-8")
    return folder


def test_each_student_has_a_folder_and_the_class_a_page(tmp_path: Path):
    out = tmp_path / "out"
    made, notes = of_class(out, "c/ada.zip", "c/bob")
    made.keep(HandIn("c/ada.zip", tmp_path), evidence(tmp_path / "e", safety_log="flying"))
    made.add(Grade("c/ada.zip", [row("1", "was accepted")], 1.5))
    made.add(Grade("c/bob", [row("1", "arrived", ok=True)]))
    assert {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()} == {
        "class.json", "index.html", "ada/report.html", "ada/results.json", "ada/feedback.txt",
        "ada/safety.log", "bob/report.html", "bob/results.json", "bob/feedback.txt",
    }  # fmt: skip
    assert json.loads((out / "ada/results.json").read_text("utf-8")) == {
        "submission": "c/ada.zip", "seconds": 1.5, "problem": "", "ok": False, "score": 0.0, "max_score": 1.0,
        "tests": [{
            "name": "1", "number": "1", "ok": False, "score": 0.0, "max_score": 1.0,
            "output": "was accepted", "visible": True, "hint": "look",
        }],
    }  # fmt: skip
    assert json.loads((out / "class.json").read_text("utf-8")) == {
        "seed": 19,
        "rubric": RUBRIC,
        "students": [
            {"name": "ada", "submission": "c/ada.zip", "folder": "ada"},
            {"name": "bob", "submission": "c/bob", "folder": "bob"},
        ],
    }
    assert 'href="safety.log"' in (out / "ada/report.html").read_text("utf-8")
    assert "bob" in (out / "index.html").read_text("utf-8")
    assert notes == []


def test_rows_are_graded_anew_with_all_others_as_they_were(tmp_path: Path):
    before, _ = of_class(tmp_path, "ada", "bob")
    before.add(Grade("ada", [row("1", "no"), row("2", "no")]))
    before.add(Grade("bob", [row("1", "no"), row("2", "no")]))
    made, _ = of_class(tmp_path, "ada", anew=True)
    made.add(Grade("ada", [row("2", "yes", ok=True)]))
    (ada,) = made.grades([HandIn("ada", tmp_path)])
    assert [(test.name, test.ok) for test in ada.tests] == [("1", False), ("2", True)]
    text = (tmp_path / "ada/feedback.txt").read_text("utf-8")
    assert text.startswith("ada: 1 of 2 points")
    assert "1 of 2" in (tmp_path / "index.html").read_text("utf-8")
    again = ClassReport(tmp_path, record_in(tmp_path) or ClassRecord(0, {}), print)
    assert [
        each.score for each in again.grades([HandIn("ada", tmp_path), HandIn("bob", tmp_path)])
    ] == [1, 0]


def test_a_late_hand_in_joins_its_class(tmp_path: Path):
    first, _ = of_class(tmp_path, "c/lab.zip")
    first.add(Grade("c/lab.zip", [row("1", "no")]))
    made, _ = of_class(tmp_path, "late/lab.zip")
    made.add(Grade("late/lab.zip", [row("1", "yes", ok=True)]))
    assert {path.name for path in tmp_path.iterdir()} == {
        "class.json", "index.html", "lab", "lab-2",
    }  # fmt: skip


FORMER = Grade("ada", [row("1", "no"), row("2", "yes", ok=True)])


@pytest.mark.parametrize(
    ("former", "new", "expected"),
    [
        (None, FORMER, FORMER),
        (FORMER, Grade("ada", [row("1", "x"), row("2", "x")], 1.0, "x"), Grade("ada", [row("1", "x"), row("2", "x")], 1.0, "x")),
        (FORMER, Grade("ada", [row("2", "x")], 1.0, "took long"), FORMER),
        (
            Grade("ada", [row("1", "yes", ok=True), row("2", NOT_FLOWN)], 9.0, "took long"),
            Grade("ada", [row("2", "yes", ok=True)]),
            Grade("ada", [row("1", "yes", ok=True), row("2", "yes", ok=True)], 9.0),
        ),
        (
            Grade("ada", [row("1", "bad"), row("2", "bad")], 9.0, "bad"),
            Grade("ada", [row("2", "yes", ok=True)]),
            Grade("ada", [row("1", "bad"), row("2", "yes", ok=True)], 9.0, "bad"),
        ),
    ],
    ids=["first", "all", "not gradable now", "its last gap is closed", "others still have no result"],
)  # fmt: skip
def test_results_are_merged(former: Grade | None, new: Grade, expected: Grade):
    assert merged(former, new) == expected


def test_what_cannot_be_graded_anew_is_refused(tmp_path: Path):
    made, _ = of_class(tmp_path, "handins/ada", "bob")
    made.add(Grade("handins/ada", [row("1", "no")]))
    with pytest.raises(Invalid, match=r"has no results of \./handins/ada") as caught:
        of_class(tmp_path, "./handins/ada", anew=True)
    assert caught.value.hint == "did you mean handins/ada?"
    with pytest.raises(Invalid, match="has no results of bob"):
        of_class(tmp_path, "bob", anew=True)
    with pytest.raises(Invalid, match="ada is given twice"):
        of_class(tmp_path, "ada", "ada")


@pytest.mark.parametrize("name", ["class.json", "ada/results.json"])
def test_damaged_results_are_named(tmp_path: Path, name: str):
    made, _ = of_class(tmp_path, "ada")
    made.add(FORMER)
    (tmp_path / name).write_text('{"seed": ', "utf-8")
    with pytest.raises(Invalid, match=name):
        of_class(tmp_path, "ada")


def test_a_report_that_cannot_be_written_costs_no_mark(tmp_path: Path):
    made, notes = of_class(tmp_path, "ada", "bob")
    for name in ("ada", "bob"):
        (tmp_path / name / "report.html").mkdir()
        (tmp_path / name / "safety.log").mkdir()
        made.keep(HandIn(name, tmp_path), evidence(tmp_path / f"e{name}", safety_log="x"))
        made.add(Grade(name, [row("1", "yes", ok=True)]))
    assert [
        each.score for each in made.grades([HandIn("ada", tmp_path), HandIn("bob", tmp_path)])
    ] == [1, 1]
    assert all("cannot be written" in note for note in notes)
    assert len(notes) == 4


def test_a_picture_that_cannot_be_drawn_is_noted(tmp_path: Path):
    made, notes = of_class(tmp_path, "ada")
    made.keep(HandIn("ada", tmp_path), evidence(tmp_path / "e", flight_mcap="no recording"))
    made.add(Grade("ada", [row("1", "yes", ok=True)]))
    assert notes == [f"no picture: {tmp_path}/ada/flight.mcap is not a recording"]
    assert (tmp_path / "ada/report.html").exists()
    assert not (tmp_path / "ada/flight.png").exists()


def test_a_class_without_the_package_that_draws_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "quadctl.cli.plot.figure", None)
    made, notes = of_class(tmp_path, "ada", "bob")
    for name in ("ada", "bob"):
        made.keep(HandIn(name, tmp_path), evidence(tmp_path / f"e{name}", flight_mcap="x"))
        made.add(Grade(name, [row("1", "yes", ok=True)]))
    assert len(notes) == 1, notes
    assert (tmp_path / "bob/report.html").exists()


def test_evidence_of_a_grading_before_goes(tmp_path: Path):
    folder = evidence(tmp_path / "ada", safety_log="old", pressure_log="old", flight_png="old")
    report.keep(evidence(tmp_path / "e", safety_log="new"), folder, print)
    assert {path.name: path.read_text("utf-8") for path in folder.iterdir()} == {
        "safety.log": "new"
    }


@pytest.mark.parametrize(
    ("student", "folder"),
    [
        ("Ada Ö_12", "Ada Ö_12"), ("Ada O\u0308", "Ada Ö"), ("../../etc/passwd", "_.._etc_passwd"), ("..", "student"),
        ("", "student"), ("a/b\\c:d*e", "a_b_c_d_e"), ("-rf ", "rf"), ("con", "_con"), ("NUL.txt", "_NUL.txt"),
        ("index.html", "index.html-2"), ("Class.JSON", "Class.JSON-2"), ("\x00\n\u202e", "___"), ("Ю" * 200, "Ю" * 60),
        ("bob", "bob-3"), ("BOB", "BOB-3"),
    ],
)  # fmt: skip
def test_a_student_has_a_folder_with_a_safe_name(student: str, folder: str):
    assert folder_name(student, ["bob", "Bob-2"]) == folder


@given(st.lists(st.text(), max_size=6))
def test_no_name_leads_out_of_the_folder_or_to_another_students(names: list[str]):
    folders: list[str] = []
    for name in names:
        folders.append(folder_name(name, folders))
    assert len({each.casefold() for each in folders}) == len(names)
    for each in folders:
        assert each not in {"", ".", ".."}
        assert Path("out", each).parts == ("out", each)
        assert PureWindowsPath("out", each).parts == ("out", each)
        assert len(each.encode()) <= 255


def test_a_record_keeps_the_rubric_as_it_was_read(tmp_path: Path):
    of_class(tmp_path, "ada")
    found = record_in(tmp_path)
    assert found is not None
    assert msgspec.to_builtins(found.rubric) == RUBRIC
    assert (found.seed, record_in(tmp_path / "nothere")) == (19, None)
