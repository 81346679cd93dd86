"""Forms of grades: each as the system that reads it wants it, whatever a student's node prints."""

import csv
import io
import json
from typing import Any, Literal
from xml.etree import ElementTree as ET

import junitparser
import msgspec
import pytest
from hypothesis import given, strategies as st
from msgspec import UNSET, Struct, UnsetType

from quadctl.cli.lab.formats import Grade, written
from quadctl.cli.lab.judge import RowResult
from quadctl.services.runtime.errors import UsageError

PASSED = RowResult("flies", "1", True, 2.0, 2.0, "arrived", True)
FAILED = RowResult("refuses", "2", False, 0.0, 1.5, "was accepted\nsafety: x", False, "compare")
ONE = [Grade("ada.zip", [PASSED, FAILED], 3.4)]
TWO = [*ONE, Grade("=bob", [PASSED], 1.0)]


def test_text_has_points_evidence_and_hints():
    assert written("text", ONE).splitlines() == [
        "ada.zip: 2 of 3.5 points",
        "  ok    1    flies: 2/2",
        "        arrived",
        "  FAIL  2    refuses: 0/1.5",
        "        was accepted",
        "        safety: x",
        "        hint: compare",
    ]


def test_no_text_of_a_hand_in_controls_a_terminal():
    evil = "\x1b[2J\x1b[Hada: 37 of 37 points\r\x9b1A"
    test = RowResult("row", "1", False, 0.0, 1.0, f"{evil}\n{evil}", True)
    for grade in (Grade("ada", [test]), Grade("ada", [test], 0.0, evil)):
        assert "\\x1b[2J" in written("text", [grade])
        (line,) = cells(grade)
        for text in (written("text", [grade]), line["comment"]):
            assert not {"\x1b", "\r", "\x9b"} & {*text}


class RowDocument(Struct, forbid_unknown_fields=True):
    """Row in the JSON, as docs/how-to/grading.md describes it."""

    name: str
    number: str
    ok: bool
    score: float
    max_score: float
    output: str
    visible: bool
    hint: str


class Document(Struct, forbid_unknown_fields=True):
    """Hand-in in the JSON."""

    submission: str
    seconds: float
    problem: str
    ok: bool
    score: float
    max_score: float
    tests: list[RowDocument]


def test_json_has_the_documented_shape():
    ada, bob = msgspec.json.decode(written("json", TWO), type=list[Document])
    assert (ada.submission, ada.seconds, ada.problem) == ("ada.zip", 3.4, "")
    assert (ada.ok, ada.score, ada.max_score) == (False, 2, 3.5)
    assert (bob.submission, bob.ok) == ("=bob", True)
    assert ada.tests[1] == RowDocument(
        "refuses", "2", False, 0.0, 1.5, "was accepted\nsafety: x", False, "compare"
    )


def test_csv_has_a_line_a_student_and_no_formula():
    header, ada, bob = csv.reader(
        io.StringIO(written("csv", [ONE[0], Grade("=bob", ONE[0].tests)]), newline="")
    )
    assert header == ["student", "points", "max_points", "comment", "flies", "refuses"]
    assert ada == [
        "ada", "2", "3.5", "2 refuses: not shown: a hidden row (hint: compare)", "2", "0",
    ]  # fmt: skip
    assert bob[0] == "'=bob"


@pytest.mark.parametrize("begin", ["=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b"])
def test_no_spreadsheet_takes_a_cell_for_a_formula(begin: str):
    evil = f"{begin}cmd|' calc'!A1, \"x\"\n=2+2"
    grade = Grade(evil, [RowResult("row", "1", False, 0.0, 1.0, evil, True)], 0.0, "")
    (line,) = cells(grade)
    assert line["student"] == f"'{evil}"
    assert line["comment"].startswith("1 row: ")
    (bad,) = cells(Grade("x", grade.tests, 0.0, evil))
    assert bad["comment"].startswith("not gradable: ")


def test_a_comment_with_commas_quotes_and_several_rows_is_one_cell():
    outputs = ['a, "b"; c', "it ended\nsafety: x", "it ended\nsafety: y"]
    tests = [
        RowResult(f"r{n}", str(n), False, 0.0, 1.0, output, True, "look, and think")
        for n, output in enumerate(outputs, 1)
    ]
    (line,) = cells(Grade("Ode, Anna", tests))
    assert line["student"] == "Ode, Anna"
    hint = "(hint: look, and think)"
    assert line["comment"] == f'1 r1: a, "b"; c {hint}; 2, 3: it ended {hint}'


def cells(*grades: Grade) -> list[dict[str, str]]:
    """Return the lines of the CSV by their columns."""
    return list(csv.DictReader(io.StringIO(written("csv", grades), newline="")))


def test_csv_has_a_cause_that_rows_share_once():
    crash = "safety crashed: KeyError: 'x' (my_safety.py, line 7)"
    tests = [
        RowResult(name, number, False, 0.0, 1.0, output, True)
        for name, number, output in [
            ("a", "1.1", f"{crash}\nsafety: KeyError: 'x'"), ("b", "3.1", "was accepted"),
            ("c", "4.1", f"{crash}\nsafety: other lines"),
        ]
    ]  # fmt: skip
    (line,) = cells(Grade("ada", tests))
    assert line["comment"] == f"1.1, 4.1: {crash}; 3.1 b: was accepted"


def test_csv_has_the_name_of_a_folder_or_the_stem_of_a_zip_file():
    given = ["all/anna.zip", "all/bob.b", "x/lab", "y/lab.ZIP", "."]
    lines = cells(*(Grade(each, [PASSED]) for each in given))
    assert [line["student"] for line in lines] == ["anna", "bob.b", "x/lab", "y/lab.ZIP", "."]


def test_a_hand_in_that_is_not_gradable_has_one_line():
    why = "bad.zip is neither a folder nor a zip file"
    tests = [RowResult(name, name, False, 0.0, 1.0, why, True) for name in ("first", "second")]
    bad = Grade("bad.zip", tests, 0.1, why)
    assert written("text", [bad]) == f"bad.zip: 0 of 2 points: not gradable: {why}\n"
    (line,) = cells(bad)
    assert line["comment"] == f"not gradable: {why}"
    assert len(json.loads(written("json", [bad]))[0]["tests"]) == 2


class GradescopeTest(Struct, forbid_unknown_fields=True):
    """Test in Gradescope's results.json, with all fields that its specification has."""

    score: float
    max_score: float
    name: str
    number: str
    output: str
    visibility: Literal["hidden", "after_due_date", "after_published", "visible"]
    status: Literal["passed", "failed"] | UnsetType = UNSET
    name_format: str | UnsetType = UNSET
    output_format: str | UnsetType = UNSET
    tags: list[str] | UnsetType = UNSET
    extra_data: dict[str, Any] | UnsetType = UNSET


class GradescopeResults(Struct, forbid_unknown_fields=True):
    """Gradescope's results.json; a score is needed on top or in each test."""

    tests: list[GradescopeTest]
    execution_time: float | UnsetType = UNSET
    score: float | UnsetType = UNSET
    output: str | UnsetType = UNSET
    visibility: str | UnsetType = UNSET
    stdout_visibility: str | UnsetType = UNSET
    extra_data: dict[str, Any] | UnsetType = UNSET
    leaderboard: list[dict[str, Any]] | UnsetType = UNSET


def test_gradescope_gets_its_results_json():
    found = msgspec.json.decode(written("gradescope", ONE), type=GradescopeResults)
    assert found.execution_time == 3
    assert found.tests == [
        GradescopeTest(2.0, 2.0, "flies", "1", "arrived", "visible"),
        GradescopeTest(
            0.0, 1.5, "refuses", "2", "was accepted\nsafety: x\nhint: compare", "after_published"
        ),
    ]


class ClassroomTest(Struct, forbid_unknown_fields=True):
    """Test in a result of GitHub Classroom, as its reporter reads it."""

    name: str
    status: Literal["pass", "fail", "error"]
    message: str
    test_code: str
    filename: str
    line_no: int
    duration: float
    score: float


class ClassroomResult(Struct, forbid_unknown_fields=True):
    """Result of GitHub Classroom."""

    version: Literal[1]
    status: Literal["pass", "fail", "error"]
    max_score: float
    tests: list[ClassroomTest]


def test_github_gets_its_result_without_evidence_of_hidden_rows():
    found = msgspec.json.decode(written("github", ONE), type=ClassroomResult)
    assert found == ClassroomResult(1, "fail", 3.5, [
        ClassroomTest("flies", "pass", "arrived", "", "", 0, 0.0, 2.0),
        ClassroomTest("refuses", "fail", "not shown: a hidden row\nhint: compare", "", "", 0, 0.0, 0.0),
    ])  # fmt: skip


JUNIT: dict[str, tuple[set[str], set[str], tuple[str, ...]]] = {
    "testsuites": (set(), {"name", "time", "tests", "failures", "errors", "disabled"}, ("testsuite",)),
    "testsuite": (
        {"name", "tests"},
        {"failures", "errors", "skipped", "time", "timestamp", "hostname", "id", "package", "disabled"},
        ("properties", "testcase", "system-out", "system-err"),
    ),
    "testcase": (
        {"name", "classname"}, {"time", "status", "assertions"},
        ("skipped", "error", "failure", "system-out", "system-err"),
    ),
    "failure": (set(), {"type", "message"}, ()),
}  # fmt: skip
"""Elements of JUnit's XML in the schema that Jenkins checks: attributes needed and allowed, and children in order."""


def test_junit_keeps_to_the_schema():
    """The order of children, the attributes, and numbers that are numbers."""
    waiting = [ET.fromstring(written("junit", TWO))]
    assert waiting[0].tag == "testsuites"
    seen = set()
    while waiting:
        element = waiting.pop()
        needed, allowed, children = JUNIT[element.tag]
        seen.add(element.tag)
        assert needed <= element.attrib.keys() <= needed | allowed
        places = [children.index(child.tag) for child in element]
        assert places == sorted(places)
        for name in element.attrib.keys() & {"time", "tests", "failures", "errors", "skipped"}:
            assert float(element.attrib[name]) >= 0
        waiting += element
    assert seen == JUNIT.keys()


def test_junit_is_read_by_a_reader_of_its_own():
    found = junitparser.JUnitXml.fromstring(written("junit", TWO).encode())
    ada, bob = found
    assert [(suite.name, suite.tests, suite.failures) for suite in (ada, bob)] == [
        ("ada.zip", 2, 1), ("=bob", 1, 0),
    ]  # fmt: skip
    passed, failed = ada
    assert (passed.classname, passed.name, passed.is_passed) == ("ada.zip", "flies", True)
    (failure,) = failed.result
    assert failure.message == "2 refuses: not shown: a hidden row"
    assert failure.text == "not shown: a hidden row\nhint: compare"
    counted = (found.tests, found.failures, found.errors)
    found.update_statistics()
    assert counted == (found.tests, found.failures, found.errors) == (3, 1, 0)


@pytest.mark.parametrize("form", ["gradescope", "github"])
def test_a_form_for_one_refuses_several(form: str):
    with pytest.raises(UsageError, match="is for one hand-in, not 2"):
        written(form, TWO)


@given(st.text(), st.text())
def test_no_output_of_a_node_breaks_a_form(output: str, name: str):
    grade = [Grade(name, [RowResult("row", "1", False, 0, 1, output, True)])]
    readers: dict[str, Any] = {
        "json": json.loads, "gradescope": json.loads, "github": json.loads, "junit": ET.fromstring,
        "csv": lambda text: list(csv.reader(io.StringIO(text, newline=""))),
    }  # fmt: skip
    for form, read in readers.items():
        assert read(written(form, grade)) is not None
    cells = readers["csv"](written("csv", grade))
    assert len(cells) == 2
    assert not cells[1][0].startswith(("=", "+", "-", "@"))
