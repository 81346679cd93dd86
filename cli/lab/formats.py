"""Forms of grades: for people, spreadsheets, and the systems of courses. Pure."""

import csv
import io
import json
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import PurePath
from typing import Any, Literal, get_args
from xml.etree import ElementTree as ET

import msgspec
from msgspec import Struct

from quadctl.cli.lab.archives import stem
from quadctl.cli.lab.judge import RowResult
from quadctl.services.runtime.errors import UsageError
from quadctl.services.runtime.terminal import escaped

Form = Literal["text", "json", "csv", "gradescope", "junit", "github"]
FORMS: tuple[str, ...] = get_args(Form)


class Grade(Struct, frozen=True):
    """Results of one hand-in, the wall-clock seconds that it took, and why it is not gradable."""

    submission: str
    tests: list[RowResult]
    seconds: float = 0.0
    problem: str = ""

    @property
    def ok(self) -> bool:
        """Return whether every row holds."""
        return all(test.ok for test in self.tests)

    @property
    def score(self) -> float:
        """Return the points."""
        return sum(test.score for test in self.tests)

    @property
    def max_score(self) -> float:
        """Return the points of all rows."""
        return sum(test.max_score for test in self.tests)

    @property
    def summary(self) -> str:
        """Return the points in words, and why it is not gradable."""
        points = f"{self.submission}: {self.score:g} of {self.max_score:g} points"
        return f"{points}: {self.fault}" if self.problem else points

    @property
    def fault(self) -> str:
        """Return why it is not gradable, in words; empty if it is."""
        return f"not gradable: {self.problem}" if self.problem else ""

    def document(self) -> dict[str, Any]:
        """Return the document that `lab check --json` prints; it can be converted back to a grade."""
        document: dict[str, Any] = msgspec.to_builtins(self)
        tests = document.pop("tests")
        points = {"ok": self.ok, "score": self.score, "max_score": self.max_score}
        return document | points | {"tests": tests}


def require_fit(form: str, count: int) -> None:
    """Raise UsageError if a form is for one hand-in, and there are more."""
    if is_of_one(form) and count != 1:
        raise UsageError(
            f"--format {form} is for one hand-in, not {count}",
            "grade one at a time, or use json, csv or junit",
        )


def is_of_one(form: str) -> bool:
    """Return whether a form is for one hand-in."""
    return form in _OF_ONE


def written(form: str, grades: Sequence[Grade]) -> str:
    """Return the grades in a form; raise as require_fit."""
    require_fit(form, len(grades))
    return _WRITERS[form](grades)


def text(grade: Grade) -> str:
    """Return a hand-in's points, rows, and hints of those that fail; one line if not gradable."""
    if grade.problem:
        return grade.summary
    lines, before = [grade.summary], ""
    for test in grade.tests:
        first, *more = test.output.splitlines() or [""]
        if test.output == before:
            # A node that does not start fails every row with the same words.
            first, more = "as above", []
        before = test.output
        mark = "ok  " if test.ok else "FAIL"
        lines.append(f"  {mark}  {test.number:4} {test.name}: {test.score:g}/{test.max_score:g}")
        lines.append(f"        {first}")
        lines += [f"        {line}" for line in more]
        if test.hint:
            lines.append(f"        hint: {test.hint}")
    return "\n".join(lines)


def _text(grades: Sequence[Grade]) -> str:
    return escaped("\n\n".join(map(text, grades))) + "\n"


def _json(grades: Sequence[Grade]) -> str:
    return _encoded([grade.document() for grade in grades])


def _csv(grades: Sequence[Grade]) -> str:
    """Return a row a hand-in: student, points, comment, and the points of each row of the rubric."""
    out = io.StringIO()
    writer = csv.writer(out)  # its own line ends, \r\n: it quotes only these two in a cell
    rows = [test.name for test in grades[0].tests] if grades else []
    writer.writerow(["student", "points", "max_points", "comment", *rows])
    names = students([grade.submission for grade in grades])
    for student, grade in zip(names, grades, strict=True):
        scores = [f"{test.score:g}" for test in grade.tests]
        comment = escaped(grade.fault or _comment(grade))
        cells = [student, f"{grade.score:g}", f"{grade.max_score:g}", comment, *scores]
        writer.writerow([_harmless(cell) for cell in cells])
    return out.getvalue()


def students(submissions: Sequence[str]) -> list[str]:
    """Return the names of the hand-ins: a folder's, or an archive's without its ending.

    Hand-ins that would have the same name keep their paths.
    """
    names = [stem(PurePath(each).name) for each in submissions]
    times = Counter(names)
    return [
        name if name and times[name] == 1 else submission
        for name, submission in zip(names, submissions, strict=True)
    ]


def _comment(grade: Grade) -> str:
    """Return the causes and hints of the rows that fail; those that several rows share once."""
    rows: dict[str, list[RowResult]] = {}
    for test in grade.tests:
        if not test.ok:
            hint = f" (hint: {test.hint})" if test.hint else ""
            cause = f"{first_line(shown(test))}{hint}"
            rows.setdefault(cause, []).append(test)
    return "; ".join(
        f"{tests[0].number} {tests[0].name}: {cause}"
        if len(tests) == 1
        else f"{', '.join(test.number for test in tests)}: {cause}"
        for cause, tests in rows.items()
    )


HIDDEN = "not shown: a hidden row"
"""Evidence of a row that students do not see, in what they read."""


def shown(test: RowResult) -> str:
    """Return the evidence of a row that its student may read."""
    return test.output if test.visible else HIDDEN


def first_line(text: str) -> str:
    """Return the first line of a text, empty without one."""
    return next(iter(text.splitlines()), "")


_FORMULA = tuple(
    "=+-@\t\r\n\N{FULLWIDTH EQUALS SIGN}\N{FULLWIDTH PLUS SIGN}\N{FULLWIDTH HYPHEN-MINUS}\N{FULLWIDTH COMMERCIAL AT}"
)
"""Characters with which a formula begins, in one spreadsheet or another (OWASP, "CSV Injection")."""


def _harmless(cell: str) -> str:
    """Return a cell that no spreadsheet takes for a formula; a student chooses its text."""
    return f"'{cell}" if cell.startswith(_FORMULA) else cell


def _gradescope(grades: Sequence[Grade]) -> str:
    """Return Gradescope's results.json."""
    grade = grades[0]
    tests = [
        {
            "name": test.name,
            "number": test.number,
            "score": test.score,
            "max_score": test.max_score,
            "output": _with_hint(test.output, test),
            "visibility": "visible" if test.visible else "after_published",
        }
        for test in grade.tests
    ]
    return _encoded({"execution_time": round(grade.seconds), "tests": tests})


def _github(grades: Sequence[Grade]) -> str:
    """Return GitHub Classroom's result, before its base64."""
    grade = grades[0]
    tests = [
        {
            "name": test.name,
            "status": "pass" if test.ok else "fail",
            "message": _with_hint(shown(test), test),
            "test_code": "",
            "filename": "",
            "line_no": 0,
            "duration": 0,
            "score": test.score,
        }
        for test in grade.tests
    ]
    status = "pass" if grade.ok else "fail"
    return _encoded({"version": 1, "status": status, "max_score": grade.max_score, "tests": tests})


def _junit(grades: Sequence[Grade]) -> str:
    """Return JUnit's XML, a test suite for each hand-in."""
    root = ET.Element("testsuites", {"name": "quadctl lab"} | _counts(grades))
    for grade in grades:
        name = _printable(grade.submission)
        suite = ET.SubElement(root, "testsuite", {"name": name, "skipped": "0"} | _counts([grade]))
        for test in grade.tests:
            case = ET.SubElement(suite, "testcase", classname=name, name=test.name, time="0")
            if not test.ok:
                failure = ET.SubElement(case, "failure", message=_printable(_line(test)))
                failure.text = _printable(_with_hint(shown(test), test))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _counts(grades: Sequence[Grade]) -> dict[str, str]:
    tests = [test for grade in grades for test in grade.tests]
    seconds = sum(grade.seconds for grade in grades)
    failures = sum(not test.ok for test in tests)
    return {
        "tests": f"{len(tests)}",
        "failures": f"{failures}",
        "errors": "0",
        "time": f"{seconds:.3f}",
    }


def _printable(words: str) -> str:
    """Return the characters that XML 1.0 may have; a student's node may log any."""
    return "".join(c if c in "\n\t" or (c >= " " and c not in "\ufffe\uffff" and not "\ud800" <= c <= "\udfff") else "?" for c in words)  # fmt: skip


def _line(test: RowResult) -> str:
    return f"{test.number} {test.name}: {first_line(shown(test))}"


def _with_hint(output: str, test: RowResult) -> str:
    return f"{output}\nhint: {test.hint}" if test.hint else output


def _encoded(document: Any) -> str:
    return json.dumps(msgspec.to_builtins(document), ensure_ascii=True) + "\n"


_WRITERS: dict[str, Callable[[Sequence[Grade]], str]] = {
    "text": _text,
    "json": _json,
    "csv": _csv,
    "gradescope": _gradescope,
    "junit": _junit,
    "github": _github,
}
_OF_ONE = {"gradescope", "github"}
