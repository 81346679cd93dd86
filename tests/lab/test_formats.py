"""Forms of grades: each as the system that reads it wants it, whatever a student's node prints."""

import csv
import io
import json
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

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


def test_json_is_a_list_of_what_check_prints():
    ada, bob = json.loads(written("json", TWO))
    assert (ada["submission"], ada["ok"], ada["score"], ada["max_score"]) == (
        "ada.zip",
        False,
        2,
        3.5,
    )
    assert bob["ok"] is True
    assert ada["tests"][1] == {
        "name": "refuses", "number": "2", "ok": False, "score": 0.0, "max_score": 1.5,
        "output": "was accepted\nsafety: x", "visible": False,
    }  # fmt: skip


def test_csv_has_a_line_a_student_and_no_formula():
    header, ada, bob = csv.reader(
        io.StringIO(written("csv", [ONE[0], Grade("=bob", ONE[0].tests)]))
    )
    assert header == ["student", "points", "max_points", "comment", "flies", "refuses"]
    assert ada == ["ada", "2", "3.5", "2 refuses: was accepted", "2", "0"]
    assert bob[0] == "'=bob"


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


def test_gradescope_gets_its_results_json():
    document = json.loads(written("gradescope", ONE))
    assert document["execution_time"] == 3
    assert document["tests"] == [
        {
            "name": "flies", "number": "1", "score": 2.0, "max_score": 2.0, "output": "arrived",
            "visibility": "visible",
        },
        {
            "name": "refuses", "number": "2", "score": 0.0, "max_score": 1.5,
            "output": "was accepted\nsafety: x\nhint: compare", "visibility": "after_published",
        },
    ]  # fmt: skip


def test_github_gets_its_version_status_and_score():
    document = json.loads(written("github", ONE))
    assert (document["version"], document["status"], document["max_score"]) == (1, "fail", 3.5)
    assert [test["status"] for test in document["tests"]] == ["pass", "fail"]
    assert document["tests"][0] == {
        "name": "flies", "status": "pass", "message": "arrived", "test_code": "", "filename": "",
        "line_no": 0, "duration": 0, "score": 2.0,
    }  # fmt: skip


def test_junit_has_a_suite_a_student():
    root = ET.fromstring(written("junit", TWO))
    assert root.tag == "testsuites"
    ada, bob = root
    assert (ada.attrib["tests"], ada.attrib["failures"]) == ("2", "1")
    assert ada[1][0].attrib["message"] == "2 refuses: was accepted"
    assert (bob.attrib["name"], len(bob[0])) == ("=bob", 0)


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
